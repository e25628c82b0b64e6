"""Verified matches of pairs of photos, by as many processes as there are cores; each pair gets the bits of one process.

COLMAP's matcher loses matches now and then on several threads; on one thread a pair has always the same matches, in any
order (docs/design_notes/cameras.md). So every process, here or on a helper, has one thread, shares of the pairs, and
for each a database with the features of its photos. What a stopped or killed run has matched is merged by the next one.
"""

from __future__ import annotations

import contextlib
import functools
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
from ..core.shares import Arguments, Need, divided, run_shares
from ..core.system import free_memory, replace_file
from .colmap import pycolmap
from .colmap_calls import is_whole_database, opened_database, require_free_space, wait_for
from .processes import MATCHING_BYTES, MIN_PAIRS, cores_for, matching_processes
from .settings import CameraSettings

_LOG = logging.getLogger(__name__)

NamePair = tuple[str, str]

_PAIRS_PER_BATCH = 24
_NEED = Need(cores=1, memory=MATCHING_BYTES)
_WHAT = "matching the photos"
_COPIED = ("cameras", "rigs", "rig_sensors", "frames", "frame_data", "images")
_COPIED_OF_PHOTOS = ("keypoints", "descriptors")
_MERGED = ("matches", "two_view_geometries")
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
    if not missing:
        return
    processes = matching_processes(cores_for(settings.threads), len(missing), free=free_memory())
    shares = divided(missing, processes, _NEED, least=MIN_PAIRS, most=_copies_on_disk(database))

    def matched(done: int) -> None:
        report((len(pairs) - len(missing) + done) / len(pairs))

    if len(shares) == 1:
        _match(database, missing, settings.seed, matched=matched, should_stop=should_stop)
        return
    try:
        _match_in_shares(database, folder, shares, processes, settings.seed, matched, should_stop)
    finally:
        _merge(database, folder)


def _match_in_shares(
    database: Path,
    folder: Path,
    shares: list[list[NamePair]],
    processes: int,
    seed: int,
    matched: Callable[[int], None],
    should_stop: StopCheck,
) -> None:
    counts: dict[int, Path] = {}

    def arguments(number: int) -> Arguments:
        # In a folder of its own, also when it is matched again: a helper that was lost may still write.
        folder.mkdir(exist_ok=True)
        part = Path(tempfile.mkdtemp(prefix=f"{number:04d}-", dir=folder)) / "database.db"
        _copy_features(database, part, {name for pair in shares[number] for name in pair})
        counts[number] = _count_file(part)
        return {"database": str(part), "pairs": shares[number], "seed": seed}

    try:
        run_shares(
            "cameras.matching:match_share", [functools.partial(arguments, number) for number in range(len(shares))],
            _NEED, what=_WHAT, processes=processes,
            watch=lambda: matched(sum(map(_read_count, counts.values()))), should_stop=should_stop,
        )  # fmt: skip
    except ChildFailure as failure:
        raise CameraError(
            f"{failure} Close other programs and run again: what is matched already is kept."
        ) from failure


def match_share(database: str, pairs: list[list[str]], seed: int) -> None:
    """Match pairs of photos in a database of their own, in a child process; their number is kept in a file beside it.

    Parameters
    ----------
    pairs : list of [str, str]
        Names of photos.

    Raises
    ------
    CameraError, DiskError
        As `match_pairs`.
    """
    count = _count_file(Path(database))
    _match(
        Path(database),
        [(first, second) for first, second in pairs],
        seed,
        matched=lambda done: write_json(count, done),
        should_stop=never_stop,
    )


def _count_file(database: Path) -> Path:
    return database.with_name("matched.json")


def _read_count(file: Path) -> int:
    if not file.is_file():
        return 0
    return read_json(file, int, advice="Run again.")


def _match(
    database: Path,
    pairs: Sequence[NamePair],
    seed: int,
    *,
    matched: Callable[[int], None],
    should_stop: StopCheck,
) -> None:
    """Match pairs in this process, in batches, after each of which `matched` receives the number of matched pairs."""
    matching = pycolmap.FeatureMatchingOptions()
    # With several threads, one run in 300 loses matches of some pairs: see docs/design_notes/cameras.md.
    matching.num_threads = 1
    matching.use_gpu = False
    verification = pycolmap.TwoViewGeometryOptions()
    verification.ransac.random_seed = seed
    pairing = pycolmap.ImportedPairingOptions()
    pairing.match_list_path = database.with_name("pairs.txt")
    for start in range(0, len(pairs), _PAIRS_PER_BATCH):
        matched(start)
        require_free_space(database.parent)
        batch = pairs[start : start + _PAIRS_PER_BATCH]
        text = "".join(f"{first} {second}\n" for first, second in batch)
        pairing.match_list_path.write_text(text, encoding="ascii")
        pycolmap.set_random_seed(seed)
        # COLMAP skips pairs that an earlier run has matched.
        wait_for(
            _WHAT,
            lambda token: pycolmap.match_image_pairs(
                database, matching, pairing, verification, pycolmap.Device.cpu, token
            ),
            report=lambda: None,
            should_stop=should_stop,
        )
    matched(len(pairs))


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


def _copy_features(database: Path, part: Path, names: set[str]) -> None:
    """Write a database with all photos of `database`, and the features of those in `names`; complete or missing."""
    require_free_space(part.parent)
    unfinished = part.with_name("unfinished.db")
    with opened_database(unfinished):
        pass  # with COLMAP's tables
    with _opened(unfinished) as opened:
        opened.execute("ATTACH ? AS whole", (str(database),))
        opened.execute("CREATE TEMP TABLE chosen (name TEXT PRIMARY KEY)")
        with opened:
            opened.executemany("INSERT INTO chosen VALUES (?)", [(name,) for name in names])
            for table in _COPIED:
                opened.execute(f"INSERT INTO {table} SELECT * FROM whole.{table}")
            for table in _COPIED_OF_PHOTOS:
                opened.execute(
                    f"INSERT INTO {table} SELECT * FROM whole.{table} WHERE image_id IN "
                    "(SELECT image_id FROM whole.images WHERE name IN chosen)"
                )
    replace_file(unfinished, part)


def _missing(database: Path, pairs: Sequence[NamePair]) -> list[NamePair]:
    """Return the pairs that are not both matched and verified."""
    with _opened(database) as opened:
        ids = dict(opened.execute("SELECT name, image_id FROM images"))
        done = {pair_id for (pair_id,) in opened.execute(_FINISHED_PAIRS)}
    return [pair for pair in pairs if pycolmap.image_pair_to_pair_id(ids[pair[0]], ids[pair[1]]) not in done]


def _merge(database: Path, folder: Path) -> None:
    """Move what the shares below `folder` hold into `database`, in the order of the shares, and delete them."""
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
    """Return the rows of the finished pairs of a share by their table; none of a damaged one."""
    if not is_whole_database(part):
        return {}
    try:
        with contextlib.closing(sqlite3.connect(part)) as opened:
            chosen = f"WHERE pair_id IN ({_FINISHED_PAIRS}) ORDER BY pair_id"
            return {table: list(opened.execute(f"SELECT * FROM {table} {chosen}")) for table in _MERGED}
    except (sqlite3.Error, UnicodeDecodeError) as error:
        _LOG.warning("%s cannot be read, so its pairs are matched again: %s", part, error)
        return {}
