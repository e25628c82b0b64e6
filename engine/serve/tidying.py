"""The server deletes by itself, at its start and while it runs: abandoned uploads, and what is long in a trash."""

from __future__ import annotations

from anyio import to_thread

from .access import Server
from .library import WebProject
from .trash import Trash
from .writers import only_writer


async def tidy_up(server: Server) -> None:
    """Delete unfinished uploads that nobody continued, and what was removed before ``trash_days``.

    Raises
    ------
    DiskError
        When something cannot be deleted.
    """
    for upload in await to_thread.run_sync(server.uploads.abandoned):
        # The event loop alone knows whether a request works on it, and none begins before this has ended.
        if not server.transfers.is_held(upload):
            async with server.transfers.held(upload):
                await to_thread.run_sync(server.uploads.forget, upload, limiter=server.transfers.writers)
    await to_thread.run_sync(_empty, server)


def _empty(server: Server) -> None:
    server.uploads.delete_strangers()
    days = server.settings.trash_days
    for trash in server.settings.data.glob("users/*/trash"):
        Trash(trash).empty(days)
    for project in server.settings.data.glob("users/*/projects/*"):
        with only_writer(project):
            WebProject(project).trash.empty(days)
