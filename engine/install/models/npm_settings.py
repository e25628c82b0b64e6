"""The settings of npm on this computer: which registry it asks, through which proxy, with which certificates.

They are read as npm reads them, so that a mirror or proxy that an administrator has set up is used; npm itself is not
needed. From the highest to the lowest: environment variables ``npm_config_...``, the user's ``.npmrc``, the computer's.
"""

from __future__ import annotations

import base64
import os
import re
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from urllib.parse import urlsplit

from ...core.files import read_text
from ...core.https import Connection
from ...core.system import npm_settings_files

_DEFAULT_REGISTRY = "https://registry.npmjs.org/"
_VARIABLE = re.compile(r"\$\{([^}]+)\}")
_MAX_BYTES = 1 << 20
_ADVICE = "Repair it, or delete it."


@dataclass(frozen=True)
class NpmSettings:
    """Settings of npm.

    Attributes
    ----------
    registry : str
        URL with a slash at its end.
    connection : Connection
        How its servers are reached.
    values : mapping of str to str
        All settings by name, with dashes.
    """

    registry: str
    connection: Connection
    values: Mapping[str, str] = field(repr=False)

    def registry_of(self, package: str) -> str:
        """Return the URL of the registry of a package: scopes (``@museum/...``) may have their own."""
        scope = package.partition("/")[0] if package.startswith("@") else ""
        return _with_slash(self.values.get(f"{scope}:registry", self.registry)) if scope else self.registry

    def tarball_url(self, url: str, registry: str) -> str:
        """Return the address of a package's file: npm asks a mirror for what a registry names at its own address."""
        stated, wanted = urlsplit(url), urlsplit(registry)
        if stated.hostname != urlsplit(_DEFAULT_REGISTRY).hostname or wanted.hostname == stated.hostname:
            return url
        return f"{wanted.scheme}://{wanted.netloc}{wanted.path.rstrip('/')}{stated.path}"

    def secrets_for(self, url: str) -> dict[str, str]:
        """Return the header with which the user is known to the server of `url`; none where no setting names one."""
        host = urlsplit(url)
        place = f"//{host.netloc}{host.path}"
        while "/" in place.removeprefix("//"):
            place = place.rpartition("/")[0]
            for start in (f"{place}/:", f"{place}:"):
                if token := self.values.get(f"{start}_authToken"):
                    return {"Authorization": f"Bearer {token}"}
                if basic := self.values.get(f"{start}_auth"):
                    return {"Authorization": f"Basic {basic}"}
                if (user := self.values.get(f"{start}username")) and (secret := self.values.get(f"{start}_password")):
                    try:
                        password = base64.b64decode(secret, validate=True)
                    except ValueError:
                        continue
                    pair = base64.b64encode(user.encode() + b":" + password).decode("ascii")
                    return {"Authorization": f"Basic {pair}"}
        return {}


def read_npm_settings() -> NpmSettings:
    """Return npm's settings on this computer.

    Raises
    ------
    FormatError
        When a file of settings is there and cannot be read.
    """
    by_variables = dict(_of_variables(os.environ))
    values: dict[str, str] = {}
    for file in npm_settings_files(by_variables):
        if file.is_file():
            values |= dict(_of_file(read_text(file, advice=_ADVICE, max_bytes=_MAX_BYTES), os.environ))
    values |= by_variables
    proxy = values.get("https-proxy") or values.get("proxy") or ""
    connection = Connection(
        certificates=_certificates(values, os.environ),
        proxy="" if proxy in ("null", "false") else proxy,
        no_proxy=values.get("noproxy", ""),
        verify=values.get("strict-ssl", "true") != "false",
        # The files of packages are checked by their SHA-256; see `catalogue`.
        plain_http=True,
    )
    return NpmSettings(_with_slash(values.get("registry", _DEFAULT_REGISTRY)), connection, values)


def _with_slash(url: str) -> str:
    return url if url.endswith("/") else f"{url}/"


def _certificates(values: Mapping[str, str], environment: Mapping[str, str]) -> tuple[Path, ...]:
    names = (values.get("cafile", ""), environment.get("NODE_EXTRA_CA_CERTS", ""))
    return tuple(Path(name) for name in names if name and name != "null")


def _of_variables(environment: Mapping[str, str]) -> Iterator[tuple[str, str]]:
    for name, value in environment.items():
        if name.lower().startswith("npm_config_") and value:
            key = name[len("npm_config_") :]
            # Names of places (``//host/:_authToken``) are kept as they are.
            yield (key if key.startswith("//") else key.lower().replace("_", "-").lstrip("-")), value


def _of_file(text: str, environment: Mapping[str, str]) -> Iterator[tuple[str, str]]:
    for line in text.splitlines():
        key, sign, value = line.strip().partition("=")
        if not sign or key.startswith(("#", ";", "[")):
            continue
        value = value.strip().strip("\"'")
        yield key.strip(), _VARIABLE.sub(lambda found: environment.get(found[1].rstrip("?"), found[0]), value)
