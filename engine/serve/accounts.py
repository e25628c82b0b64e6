"""Users, their tokens and their sessions.

Tokens are random, shown once and stored as SHA-256. A session is a cookie that the server has signed, so that it
outlives the server and that no list of sessions is kept. Removing a user, or giving a new token, ends all sessions.
"""

from __future__ import annotations

import hashlib
import hmac
import re
import secrets
import time
from pathlib import Path

from ..errors import SettingsError
from ..files import atomic_write, read_bytes, read_json, write_json

__all__ = ["LOCAL_USER", "Accounts"]

LOCAL_USER = "local"
"""The only user of a server that other computers cannot reach."""
_NAME = re.compile(r"[a-z0-9][a-z0-9_-]{0,31}")
_SECRET_BYTES = 32
_ADVICE = "Delete it, and add the users again."


class Accounts:
    """Users of the server whose data is in `folder`.

    Parameters
    ----------
    folder : Path
        The server's data folder; created when it does not exist.
    """

    def __init__(self, folder: Path) -> None:
        self._file = folder / "users.json"
        self._secret = _stored_secret(folder / "secret.bin")

    def add(self, name: str) -> str:
        """Add a user, or give a user a new token, and return the token.

        Raises
        ------
        SettingsError
            When the name cannot be that of a user.
        DiskError
            When it cannot be stored.
        """
        if not _NAME.fullmatch(name) or name == LOCAL_USER:
            raise SettingsError(
                f"{name!r} cannot be the name of a user. Use up to 32 small letters, digits, - and _, and another word "
                f"than {LOCAL_USER}."
            )
        token = secrets.token_urlsafe(24)
        write_json(self._file, {**self._hashes(), name: _hash(token)})
        return token

    def remove(self, name: str) -> None:
        """Remove a user; the user's projects stay.

        Raises
        ------
        SettingsError
            When there is no such user.
        """
        hashes = self._hashes()
        if name not in hashes:
            raise SettingsError(f"There is no user {name!r}. The users are: {', '.join(hashes) or 'none'}.")
        del hashes[name]
        write_json(self._file, hashes)

    def names(self) -> list[str]:
        """Return the names of all users."""
        return sorted(self._hashes())

    def user_of_token(self, token: str) -> str | None:
        """Return the user with this token, or None."""
        digest = _hash(token)
        # All are compared, so that the time does not tell which ones came close.
        matches = [
            name for name, known in self._hashes().items() if hmac.compare_digest(known.encode(), digest.encode())
        ]
        return matches[0] if matches else None

    def new_session(self, user: str, days: float) -> str:
        """Return the value of a cookie for `user`."""
        content = f"{user}.{int(time.time() + days * 86400)}"
        return f"{content}.{self._signed(content, user)}"

    def user_of_session(self, cookie: str) -> str | None:
        """Return the user of a cookie; None when it is not ours, has expired, or the user was removed."""
        user, _, rest = cookie.partition(".")
        expires, _, signature = rest.partition(".")
        if not hmac.compare_digest(signature.encode(), self._signed(f"{user}.{expires}", user).encode()):
            return None
        is_user = user == LOCAL_USER or user in self._hashes()
        return user if is_user and expires.isdecimal() and int(expires) > time.time() else None

    def csrf_token(self, cookie: str) -> str:
        """Return what a page must send beside the cookie, and what another site's page cannot know."""
        return self._signed(f"csrf {cookie}", "")

    def _signed(self, content: str, user: str) -> str:
        # With the hash of the token: a new token ends the sessions of the old one.
        key = self._secret + self._hashes().get(user, "").encode()
        return hmac.new(key, content.encode(), hashlib.sha256).hexdigest()

    def _hashes(self) -> dict[str, str]:
        if not self._file.exists():
            return {}
        hashes: dict[str, str] = read_json(self._file, {str: str}, advice=_ADVICE)
        return hashes


def _hash(token: str) -> str:
    # No slow hash: a token has 192 random bits and cannot be guessed.
    return hashlib.sha256(token.encode()).hexdigest()


def _stored_secret(file: Path) -> bytes:
    """Return the key that signs sessions; made at the first start."""
    if not file.exists():
        file.parent.mkdir(parents=True, exist_ok=True)
        with atomic_write(file) as stream:
            stream.write(secrets.token_bytes(_SECRET_BYTES))
        file.chmod(0o600)
    return read_bytes(file, max_bytes=_SECRET_BYTES, advice="Delete it; all users then sign in again.")
