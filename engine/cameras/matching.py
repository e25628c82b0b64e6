"""Verified matches of pairs of photos, by as many processes as there are cores; each pair gets the bits of one process.

COLMAP's matcher loses matches now and then on several threads; on one thread a pair has always the same matches, in any
order (docs/design_notes/cameras.md). So every process, here or on a helper, has one thread, takes some pairs after the
other, and has a database of its own with the features of their photos. What a stopped or killed run has matched is
merged by the next one.
"""

from __future__ import annotations

import contextlib
import logging
import shutil
import sqlite3
import tempfile
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from typing import Any

from ..core.child_process import ChildFailure
from ..core.errors import CameraError, DiskError
from ..core.events import StopCheck, never_stop
from ..core.files import delete_derived, read_json, write_json
from ..core.settings import to_dict
from ..core.shares import Need, count_taken, helper_places, run_shares, taken_items
from ..core.system import free_memory
from .colmap import pycolmap
from .colmap_calls import create_database, is_whole_database, require_free_space, wait_for
from .processes import MATCHING_BYTES, MIN_PAIRS, cores_for, matching_processes
from .settings import CameraSettings

_LOG = logging.getLogger(__name__)

NamePair = tuple[str, str]

_PAIRS_PER_BATCH = 24
_NEED = Need(cores=1, memory=MATCHING_BYTES)
_WHAT = "matching the photos"
_BATCHES_FILE = "batches.json"
_COPIED = ("cameras", "rigs", "rig_sensors", "frames", "frame_data", "images")
_COPIED_OF_PHOTOS = ("keypoints", "descriptors")
_MERGED = ("matches", "two_view_geometries")
_READ_BY_MAPPING = (*_COPIED, "keypoints", "two_view_geometries")
_FINISHED_PAIRS = "SELECT pair_id FROM matches INTERSECT SELECT pair_id FROM two_view_geometries"
"""Of a pair that COLMAP has matched and not verified, nothing is kept."""


def match_pairs(
    database: Path,
    pairs: Sequence[NamePair],
    settings: CameraSettings,
    *,
    report: Callable[[float], None],
    should_stop: StopCheck,
) -> None:
    """Match and verify pairs of photos, except those that `database` has already.

    Parameters
    ----------
    database : Path
        Of COLMAP, with features. Other files are made in its folder, which are gone at the end.
    pairs : sequence of (str, str)
        Names of photos, sorted.
    report : callable
        Receives the matched share of `pairs`.

    Raises
    ------
    CameraError
        When COLMAP fails or a process ends before its work.
    DiskError
        When the disk is full.
    Cancelled
        When `should_stop` returned True.
    """
    folder = database.parent / "shares"
    _merge(database, folder)
    missing = _missing(database, pairs)

    def left(count: int) -> None:
        report(1.0 - max(0, count) / max(1, len(pairs)))

    processes = matching_processes(cores_for(settings.threads), len(missing), free=free_memory())
    processes = max(1, min(processes, _copies_on_disk(database)))
    if processes > 1 or (len(missing) >= 2 * MIN_PAIRS and helper_places(_NEED)):
        try:
            _match_in_shares(database, folder, missing, processes, settings, left, should_stop)
        finally:
            _merge(database, folder)
        # What a lost helper had taken.
        missing = _missing(database, pairs)
    _match(database, missing, settings, left=left, should_stop=should_stop)


def _match_in_shares(
    database: Path,
    folder: Path,
    pairs: Sequence[NamePair],
    processes: int,
    settings: CameraSettings,
    left: Callable[[int], None],
    should_stop: StopCheck,
) -> None:
    """Match pairs in several processes; those that one has taken that was lost are missing afterwards."""
    folder.mkdir()
    # Neighbours in the order of the pairs, which have few photos.
    batches = _batches(pairs)
    write_json(folder / _BATCHES_FILE, batches)
    try:
        run_shares(
            "cameras.matching:match_share",
            {"database": str(database), "folder": str(folder), "settings": to_dict(settings)},
            len(batches), _NEED, folder=folder, what=_WHAT, processes=processes,
            watch=lambda: left(len(pairs) - _PAIRS_PER_BATCH * count_taken(folder)), should_stop=should_stop,
        )  # fmt: skip
    except ChildFailure as failure:
        raise CameraError(
            f"{failure} Close other programs and run again: what is matched already is kept."
        ) from failure


def copy_for_mapping(database: Path, own: Path) -> None:
    """Write what mapping reads of a database into a new one at `own`.

    Raises
    ------
    DiskError
        When the disk is full.
    """
    create_database(own)
    with _opened(own) as opened:
        opened.execute("ATTACH ? AS whole", (str(database),))
        with opened:
            for table in _READ_BY_MAPPING:
                opened.execute(f"INSERT INTO {table} SELECT * FROM whole.{table}")


def match_share(database: str, folder: str, settings: dict[str, Any]) -> None:
    """Match pairs that no other process has taken, in a child process with a database of its own.

    Parameters
    ----------
    database : str
        With the features; only read.
    folder : str
        Where the pairs stand, and the database is made.
    settings : dict
        Of `CameraSettings`, by `to_dict`.

    Raises
    ------
    CameraError, DiskError
        As `match_pairs`.
    """
    shares, chosen = Path(folder), CameraSettings(**settings)
    batches = read_json(shares / _BATCHES_FILE, [[[str]]], advice="Run again.")
    own = Path(tempfile.mkdtemp(prefix="process-", dir=shares)) / "database.db"
    create_database(own)
    for number in taken_items(shares, len(batches)):
        _copy_features(Path(database), own, {name for pair in batches[number] for name in pair})
        _match(own, batches[number], chosen, left=lambda count: None, should_stop=never_stop)


def _batches(pairs: Sequence[NamePair]) -> list[Sequence[NamePair]]:
    return [pairs[start : start + _PAIRS_PER_BATCH] for start in range(0, len(pairs), _PAIRS_PER_BATCH)]


def _match(
    database: Path,
    pairs: Sequence[NamePair],
    settings: CameraSettings,
    *,
    left: Callable[[int], None],
    should_stop: StopCheck,
) -> None:
    """Match pairs in this process, in batches; before each of them `left` receives the number of pairs to match."""
    matching = pycolmap.FeatureMatchingOptions()
    # With several threads, one run in 300 loses matches of some pairs: see docs/design_notes/cameras.md.
    matching.num_threads = 1
    matching.use_gpu = False
    verification = pycolmap.TwoViewGeometryOptions()
    verification.ransac.random_seed = settings.seed
    pairing = pycolmap.ImportedPairingOptions()
    pairing.match_list_path = database.with_name("pairs.txt")
    for number, batch in enumerate(_batches(pairs)):
        left(len(pairs) - _PAIRS_PER_BATCH * number)
        require_free_space(database.parent)
        text = "".join(f"{first} {second}\n" for first, second in batch)
        pairing.match_list_path.write_text(text, encoding="ascii")
        pycolmap.set_random_seed(settings.seed)
        # COLMAP skips pairs that an earlier run has matched.
        wait_for(
            _WHAT,
            lambda token: pycolmap.match_image_pairs(
                database, matching, pairing, verification, pycolmap.Device.cpu, token
            ),
            should_stop=should_stop,
        )
    left(0)


def _copies_on_disk(database: Path) -> int:
    """Return how many copies of a database the disk can hold."""
    return int(shutil.disk_usage(database.parent).free / (database.stat().st_size + 1))


@contextlib.contextmanager
def _opened(path: Path) -> Iterator[sqlite3.Connection]:
    try:
        with contextlib.closing(sqlite3.connect(path)) as connection:
            # As COLMAP: after a power failure the work starts again.
            connection.execute("PRAGMA synchronous = OFF")
            yield connection
    except (sqlite3.Error, UnicodeDecodeError) as error:
        raise DiskError(f"{path} cannot be used: {error}. Free some space and run again.") from error


def _copy_features(database: Path, own: Path, names: set[str]) -> None:
    """Copy all photos of `database` that `own` has not, and the features of those in `names`."""
    require_free_space(own.parent)
    with _opened(own) as opened:
        opened.execute("ATTACH ? AS whole", (str(database),))
        opened.execute("CREATE TEMP TABLE chosen (name TEXT PRIMARY KEY)")
        with opened:
            opened.executemany("INSERT INTO chosen VALUES (?)", [(name,) for name in names])
            for table in _COPIED:
                opened.execute(f"INSERT OR IGNORE INTO {table} SELECT * FROM whole.{table}")
            for table in _COPIED_OF_PHOTOS:
                opened.execute(
                    f"INSERT OR IGNORE INTO {table} SELECT * FROM whole.{table} WHERE image_id IN "
                    "(SELECT image_id FROM whole.images WHERE name IN chosen)"
                )


def _missing(database: Path, pairs: Sequence[NamePair]) -> list[NamePair]:
    """Return the pairs that are not both matched and verified."""
    with _opened(database) as opened:
        ids = dict(opened.execute("SELECT name, image_id FROM images"))
        done = {pair_id for (pair_id,) in opened.execute(_FINISHED_PAIRS)}
    return [pair for pair in pairs if pycolmap.image_pair_to_pair_id(ids[pair[0]], ids[pair[1]]) not in done]


def _merge(database: Path, folder: Path) -> None:
    """Move what the processes of `folder` have matched into `database`, and delete the folder."""
    for part in sorted(folder.glob("*/database.db")):
        found = _finished(part)
        with _opened(database) as opened, opened:
            for table, rows in found.items():
                if rows:
                    places = ", ".join("?" * len(rows[0]))
                    opened.executemany(f"INSERT OR IGNORE INTO {table} VALUES ({places})", rows)
    if folder.exists():
        delete_derived(folder.parent, folder.name)


def _finished(part: Path) -> dict[str, list[tuple[Any, ...]]]:
    """Return the rows of the finished pairs of a database by their table; none of a damaged one."""
    if not is_whole_database(part):
        return {}
    try:
        with contextlib.closing(sqlite3.connect(part)) as opened:
            chosen = f"WHERE pair_id IN ({_FINISHED_PAIRS}) ORDER BY pair_id"
            return {table: list(opened.execute(f"SELECT * FROM {table} {chosen}")) for table in _MERGED}
    except (sqlite3.Error, UnicodeDecodeError) as error:
        _LOG.warning("%s cannot be read, so its pairs are matched again: %s", part, error)
        return {}
