"""Users, their tokens and their sessions.

Tokens are random, shown once and stored as SHA-256. A session is a cookie that the server has signed, so that it
outlives the server; only those that were ended by signing out are listed. Removing a user, or giving a new token, ends
all sessions. A code signs a phone in once, within minutes, and is never stored.
"""

from __future__ import annotations

import hashlib
import hmac
import re
import secrets
import threading
import time
from pathlib import Path

from ..core.errors import SettingsError
from ..core.files import atomic_write, read_bytes, read_json, write_json

LOCAL_USER = "local"
"""The only user of a server that other computers cannot reach."""
_NAME = re.compile(r"[a-z0-9][a-z0-9_-]{0,31}")
_SECRET_BYTES = 32
_SESSION_BYTES = 12
_CODE_SECONDS = 900.0
"""How long a code signs in."""
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
        self._ended_file = folder / "ended_sessions.json"
        self._ending = threading.Lock()
        self._ended = _read_ended(self._ended_file)
        self._codes: dict[str, tuple[str, float]] = {}

    @property
    def cookie_name(self) -> str:
        """Name of the cookie of a session. Browsers send a cookie to all servers of a computer, whatever their port."""
        return f"session-{self._signed('cookie name', '')[:8]}"

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
        write_json(self._file, {**self._hashes(), name: _hash(token)}, private=True)
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
        write_json(self._file, hashes, private=True)

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
        content = f"{user}.{int(time.time() + days * 86400)}.{secrets.token_hex(_SESSION_BYTES)}"
        return f"{content}.{self._signed(content, user)}"

    def user_of_session(self, cookie: str) -> str | None:
        """Return the user of a cookie; None when it is not ours, has expired or ended, or the user was removed."""
        content, _, signature = cookie.rpartition(".")
        user, _, rest = content.partition(".")
        expires, _, number = rest.partition(".")
        if not hmac.compare_digest(signature.encode(), self._signed(content, user).encode()):
            return None
        is_user = user == LOCAL_USER or user in self._hashes()
        is_current = expires.isdecimal() and int(expires) > time.time() and number not in self._ended
        return user if is_user and is_current else None

    def end_session(self, cookie: str) -> None:
        """Make a cookie worthless, also for whoever has a copy of it.

        Raises
        ------
        DiskError
            When it cannot be stored.
        """
        if self.user_of_session(cookie) is None:
            return
        _, expires, number, _ = cookie.split(".")
        with self._ending:
            now = time.time()
            kept = {one: until for one, until in self._ended.items() if until > now}
            self._ended = {**kept, number: int(expires)}
            write_json(self._ended_file, self._ended, private=True)

    def new_code(self, user: str) -> str:
        """Return a code that signs `user` in once, in the next 15 minutes, while this server runs."""
        code = secrets.token_urlsafe(24)
        with self._ending:
            self._codes[_hash(code)] = (user, time.monotonic() + _CODE_SECONDS)
        return code

    def user_of_code(self, code: str) -> str | None:
        """Return the user whom a code signs in, or None; it is used up then."""
        with self._ending:
            user, until = self._codes.pop(_hash(code), ("", 0.0))
        return user if user in self._hashes() and time.monotonic() < until else None

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


def _read_ended(file: Path) -> dict[str, int]:
    """Return the sessions that were ended by signing out, with the times at which they would have expired."""
    ended: dict[str, int] = read_json(file, {str: int}, advice="Delete it, and secret.bin.") if file.exists() else {}
    return ended


def _stored_secret(file: Path) -> bytes:
    """Return the key that signs sessions; made at the first start."""
    if not file.exists():
        file.parent.mkdir(parents=True, exist_ok=True)
        with atomic_write(file, private=True) as stream:
            stream.write(secrets.token_bytes(_SECRET_BYTES))
    return read_bytes(file, max_bytes=_SECRET_BYTES, advice="Delete it; all users then sign in again.")
