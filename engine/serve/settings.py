"""Settings of the web server. The limits protect the computer from mistakes and from hostile clients."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from ..core.errors import PromptError
from ..rasterizer.settings import DeviceName


@dataclass(frozen=True)
class ServeSettings:
    """Where the server keeps its data and listens, and what it accepts.

    Parameters
    ----------
    data : Path
        Folder of all users' projects.
    host, port : str, int
        Address to listen on; port 0 takes a free one.
    lan : bool
        Whether other computers may connect: with TLS, and with a token for each user.
    names : tuple of str
        With `lan`: names and addresses by which clients reach the server; empty takes those of this computer.
    first_user : str
        With `lan`: the user whom the QR code of the address signs in; empty: the only one, if there is only one.
    stop_jobs : bool
        Whether the running job is stopped with the server and continued by the next one. Otherwise it goes on.
    scheduler : str
        Address of a Dask scheduler whose workers do the jobs; they share the data folder, by the same path. Empty: one
        job at a time on this computer.
    device : {"auto", "cpu", "gpu"}
        What jobs train and render on, see ``reconstruct --device``.
    fetch_models : bool or None
        Whether users may have a model fetched to this computer, for all users. None: not with `lan`, as it is the
        owner who decides what is installed on a server that others use; without it, the user is the owner.
    max_photo_bytes, max_video_bytes, max_user_bytes : int
        Largest photo, largest video, and all files that a user has uploaded.
    max_photos : int
        Photos of a project.
    max_projects : int
        Projects of a user.
    max_open_uploads : int
        Uploads of a user that have begun and not ended.
    max_waiting : int
        Jobs of a user that wait.
    max_body_bytes : int
        Largest body of a request that is no upload.
    max_prompt : int
        Characters of a text that a user enters.
    max_clicks : int
        Clicks of one prompt.
    max_connections, max_address_connections : int
        Connections at a time, of all and of one address. A further one ends the one that has been without a request for
        longest; where all have one, it is refused.
    max_user_requests : int
        Requests of a user at a time, streams of events included.
    max_streams : int
        Streams of events of a user at a time.
    max_browser_streams : int
        Streams of one browser: it has at most six connections to a server, for all its tabs. A further stream takes the
        place of the oldest.
    max_user_exports : int
        Exports, reports and forecasts of a user that wait; one of a kind at a time is made.
    min_free_bytes : int
        Free disk space below which nothing is accepted.
    read_seconds : float
        Longest pause of a client that sends a request or gets an answer, and the time in which a request that is no
        upload must have arrived.
    header_seconds : float
        Time in which a new connection must have sent the head of a request, and in which the next one must follow.
    min_upload_rate : float
        Bytes per second of an upload, after the first `read_seconds`, below which it is ended; it can be continued.
    session_days : float
        Time after which a user signs in again.
    upload_days : int
        Time after which an unfinished upload is deleted.
    trash_days : int
        Time after which what a user removed is deleted.
    tidy_seconds : float
        Time between two looks for what is to be deleted.
    """

    data: Path
    host: str = "127.0.0.1"
    port: int = 8765
    lan: bool = False
    names: tuple[str, ...] = ()
    first_user: str = ""
    stop_jobs: bool = False
    scheduler: str = ""
    device: DeviceName = "auto"
    fetch_models: bool | None = None
    max_photo_bytes: int = 200 << 20
    max_video_bytes: int = 4 << 30
    max_user_bytes: int = 50 << 30
    max_photos: int = 1000
    max_projects: int = 1000
    max_open_uploads: int = 200
    max_waiting: int = 50
    max_body_bytes: int = 1 << 20
    max_prompt: int = 500
    max_clicks: int = 100
    max_connections: int = 500
    max_address_connections: int = 300
    max_user_requests: int = 150
    max_streams: int = 64
    max_browser_streams: int = 3
    max_user_exports: int = 20
    min_free_bytes: int = 2 << 30
    read_seconds: float = 30.0
    header_seconds: float = 15.0
    min_upload_rate: float = 1000.0
    session_days: float = 30.0
    upload_days: int = 2
    trash_days: int = 30
    tidy_seconds: float = 600.0

    @property
    def users_may_fetch(self) -> bool:
        """Whether users may have a model fetched to this computer."""
        return not self.lan if self.fetch_models is None else self.fetch_models

    def require_short(self, prompt: str) -> None:
        """Raise `PromptError` for a text that is too long."""
        if len(prompt) > self.max_prompt:
            raise PromptError(f"A prompt has at most {self.max_prompt} characters.")
