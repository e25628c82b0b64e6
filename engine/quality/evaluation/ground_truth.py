"""True masks of photos, in our own layout and in the layouts of three benchmarks."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path, PurePath
from typing import Any, Literal, NamedTuple

import cv2
import numpy as np
from numpy.typing import NDArray

from ...core.arrays import Mask
from ...core.errors import FormatError, HeritageError, MaskError
from ...core.files import is_inner_name, opened, optional, read_json, read_text
from ...scene import photos_called
from .settings import Layout

_MIN_PIXELS = 100
"""Smallest mask in a picture of instance ids, in pixels. Smaller ones would not be annotated by hand."""

_STRIP_ROWS = 256
_MAX_PIXELS = 200_000_000
"""Largest picture of a mask, in pixels."""
_MAX_MASK_PIXELS = 1 << 30
"""Largest number of pixels of all masks of a photo."""
_MAX_COORDINATE = 1e6
"""Largest coordinate of a polygon's corner, pixels."""
_LABEL = {
    "info": {"name": str, "width": int, "height": int},
    "objects": [{"category": str, "segmentation": list}],
}

_ABSENT_ADVICE = 'It must be a list of texts for things that the scene does not show, ["dog", "piano"].'

_KNOWN_LAYOUTS = (
    "museum: masks/ and names.json; lerf-mask: test_mask/VIEW/PROMPT.png; 3d-ovs: segmentations/VIEW/CLASS.png and "
    "segmentations/classes.txt; lerf-ovs: JSON files with `info` and `objects`"
)


@dataclass(frozen=True)
class GroundTruth:
    """Which pixels of which photos show which object.

    Attributes
    ----------
    layout : str
        Layout of the folder, see `Layout`.
    photos : tuple of str
        Photos with at least one mask, by their names in the project, in order.
    objects : tuple of str
        All objects of all photos, in order.
    prompts : mapping of str to str
        Text that names each object; equal objects share one.
    unplaced : tuple of str
        Views with masks whose photo has no camera in the project.
    every_pixel : bool
        Whether a pixel in no mask is known to show none of the objects. Then the masks of all photos together
        determine the object of each Gaussian.
    readers : dict
        By photo: a function that returns the masks of `objects` and `ignored`, some of which may be empty.
    ignored : tuple of str
        Things that are neither objects nor background, such as furniture: a search for all objects may return them.
    absent : tuple of str
        Texts for things that the scene does not show.
    """

    layout: Layout
    photos: tuple[str, ...]
    objects: tuple[str, ...]
    prompts: Mapping[str, str]
    unplaced: tuple[str, ...]
    every_pixel: bool
    readers: dict[str, Callable[[], dict[str, Mask]]]
    ignored: tuple[str, ...] = ()
    absent: tuple[str, ...] = ()

    def masks(self, photo: str) -> dict[str, Mask]:
        """Return the masks of a photo by object, bool [h, w]: the whole photo, upright, at any resolution.

        Objects that the photo does not show are missing; no mask is empty.

        Raises
        ------
        MaskError
            When a file cannot be read.
        """
        return {name: mask for name, mask in self.readers[photo]().items() if name in self.prompts and mask.any()}

    def ignored_masks(self, photo: str) -> dict[str, Mask]:
        """Return the masks of the `ignored` things in a photo, in the same way as `masks`."""
        return {name: mask for name, mask in self.readers[photo]().items() if name in self.ignored and mask.any()}


def read_ground_truth(
    folder: Path, placed: Sequence[str], unregistered: Sequence[str] = (), *, layout: Layout | Literal["auto"] = "auto"
) -> GroundTruth:
    """Return the true masks in a folder. Each file is read when it is needed.

    Parameters
    ----------
    folder : Path
        Folder in one of these layouts:

        - ``museum``: ``masks/<photo>.png`` with instance ids and ``names.json`` (id: prompt, a name where several
          share one, and ``"ignore": true`` for things that are not evaluated); optionally ``absent.json``, a list of
          texts for things that the scene does not show.
        - ``lerf-mask``, as Gaussian Grouping ships it: ``test_mask/<view>/<prompt>.png``. A view is a number counting,
          in order of their names, the pictures of ``images/`` that are not in ``images_train/`` beside it; or the
          name of a photo.
        - ``3d-ovs``: ``segmentations/<view>/<class>.png`` and ``segmentations/classes.txt``. A view is a number
          counting the pictures of ``images/`` beside it, or the project's photos; or the name of a photo.
        - ``lerf-ovs``, as LangSplat ships it, ``label/<scene>``: ``<photo>.json`` with a polygon and a category for
          each thing; polygons of one category in one photo are one mask.

        The folder itself, or ``test_mask`` or ``segmentations`` in it.
    placed : sequence of str
        Photos with a camera.
    unregistered : sequence of str
        Further photos of the scene.
    layout : str
        ``auto`` detects it.

    Raises
    ------
    FormatError
        When the folder has another layout, or no mask of a photo with a camera.
    MaskError
        When a file cannot be read.
    """
    if not folder.is_dir():
        raise FormatError(f"{folder} is not a folder. Name the folder with the true masks: {_KNOWN_LAYOUTS}.")
    known = layout if layout != "auto" else _detect_layout(folder)
    readers = {"museum": _museum, "lerf-mask": _lerf_mask, "3d-ovs": _three_d_ovs, "lerf-ovs": _lerf_ovs}
    read = readers[known](folder, _Photos(placed, unregistered))
    views, named = read.views, read.prompts
    found = {photo: masks for photo, masks in views.items() if photo in placed}
    if not found:
        names = ", ".join(sorted(views)[:3]) or "none"
        raise FormatError(
            f"{folder} has no masks for the photos of this project (it has: {names}). Evaluate the project that was "
            "made from the same photos."
        )
    unplaced = tuple(sorted(set(views) - set(found)))
    prompts = dict(named) if isinstance(named, Mapping) else {name: name for name in named}
    return GroundTruth(
        known,
        tuple(sorted(found)),
        tuple(prompts),
        prompts,
        unplaced,
        every_pixel=known == "museum",
        readers=found,
        ignored=read.ignored,
        absent=read.absent,
    )


class _Read(NamedTuple):
    """The true masks in a folder.

    Attributes
    ----------
    views : dict
        Readers by photo, or by the name of the view where no photo has it.
    prompts : mapping of str to str, or sequence of str
        All objects, with prompts where these differ from their names.
    ignored, absent : tuple of str
        See `GroundTruth`.
    """

    views: dict[str, Callable[[], dict[str, Mask]]]
    prompts: Mapping[str, str] | Sequence[str]
    ignored: tuple[str, ...] = ()
    absent: tuple[str, ...] = ()


def _detect_layout(folder: Path) -> Layout:
    if (folder / "masks").is_dir() and (folder / "names.json").is_file():
        return "museum"
    if (_below(folder, "segmentations") / "classes.txt").is_file():
        return "3d-ovs"
    if _below(folder, "test_mask").name == "test_mask":
        return "lerf-mask"
    if any(folder.glob("*.json")):
        return "lerf-ovs"
    raise FormatError(f"{folder} holds true masks in no known layout ({_KNOWN_LAYOUTS}).")


def _below(folder: Path, name: str) -> Path:
    """Return the folder `name` in `folder` if there is one, else `folder` itself."""
    return folder / name if (folder / name).is_dir() else folder


class _Photos:
    """The photos of a project, looked up by the names that a benchmark gives its views."""

    def __init__(self, placed: Sequence[str], unregistered: Sequence[str]) -> None:
        self.names = sorted({*placed, *unregistered})

    def called(self, view: str) -> str:
        """Return the photo that `view` means (`engine.scene.match_names`); `view` itself when there is none.

        Raises
        ------
        FormatError
            When several photos have that name.
        """
        same = photos_called(view, self.names)
        if len(same) > 1:
            raise FormatError(f"The masks are of {view}, but several photos have that name: {', '.join(same[:3])}.")
        return same[0] if same else view

    def of_views(self, folders: Sequence[Path], counted: Sequence[str] | None, how: str) -> dict[str, Path]:
        """Return view folders by photo: by name where all are names, else by their number among `counted`.

        Raises
        ------
        FormatError
            When the numbers exceed the list; `how` tells the user what to do then.
        """
        by_name = {self.called(folder.name): folder for folder in folders}
        if all(photo in self.names for photo in by_name):
            return by_name
        if not all(folder.name.isdecimal() for folder in folders):
            return by_name
        if counted is None:
            raise FormatError(f"The views of {folders[0].parent} are numbered. {how}")
        numbers = [int(folder.name) for folder in folders]
        if max(numbers) >= len(counted):
            raise FormatError(
                f"{folders[0].parent} has masks for view {max(numbers)}, but there are only {len(counted)} to count "
                f"(0 is the first). {how}"
            )
        return {self.called(counted[number]): folder for number, folder in zip(numbers, folders, strict=True)}


def _museum(folder: Path, photos: _Photos) -> _Read:
    entries = _entries(folder / "names.json")
    objects = {number: entry for number, entry in entries.items() if not entry.ignore}
    ignored = tuple(dict.fromkeys(entry.name for entry in entries.values() if entry.ignore))
    prompts = {entry.name: entry.prompt for entry in objects.values()}
    absent: tuple[str, ...] = ()
    if (folder / "absent.json").exists():
        absent = tuple(dict.fromkeys(read_json(folder / "absent.json", [str], advice=_ABSENT_ADVICE)))
        shown = next((entry.prompt for entry in entries.values() if entry.prompt in absent), None)
        if shown is not None:
            raise FormatError(f"{folder / 'absent.json'} lists {shown!r}, but names.json has it. {_ABSENT_ADVICE}")

    def read(file: Path) -> dict[str, Mask]:
        ids = _picture(file, "ids")
        masks = {
            entry.name: ids == number
            for number, entry in objects.items()
            if np.count_nonzero(ids == number) >= _MIN_PIXELS
        }
        for name in ignored:
            masks[name] = np.isin(ids, [number for number, entry in entries.items() if entry.name == name])
        return masks

    files = sorted((folder / "masks").glob("*.png"))
    if not files:
        raise FormatError(f"{folder / 'masks'} holds no PNG with instance ids.")
    return _Read({photos.called(file.stem): _deferred(read, file) for file in files}, prompts, ignored, absent)


class _Entry(NamedTuple):
    """The entry of ``names.json`` for one instance id."""

    name: str
    prompt: str
    ignore: bool


def _entries(file: Path) -> dict[int, _Entry]:
    """Return the entries of a ``names.json`` by instance id; at least one of them is not ignored."""
    advice = 'It must be of the form {"1": {"prompt": "vase"}}.'
    schema = {str: {"prompt": str, "name": optional((str, None)), "ignore": optional(bool)}}
    data = read_json(file, schema, advice=advice)
    wrong = next(
        (number for number in data if not (number.isascii() and number.isdecimal() and len(number) < 10)), None
    )
    if wrong is not None:
        raise FormatError(f"{file} has {wrong[:40]!r} in place of an instance id. {advice}")
    entries = {
        int(number): _Entry(entry.get("name") or entry["prompt"], entry["prompt"], entry.get("ignore", False))
        for number, entry in data.items()
    }
    # Ignored things may share a name, because nothing is said about a single one.
    names = [entry.name for entry in entries.values() if not entry.ignore]
    names += dict.fromkeys(entry.name for entry in entries.values() if entry.ignore)
    twice = next((name for name in names if names.count(name) > 1), None)
    if twice is not None:
        raise FormatError(f"{file} calls several objects {twice!r}. Give each a name of its own.")
    if not any(not entry.ignore for entry in entries.values()):
        raise FormatError(f"{file} names no object to evaluate. {advice}")
    return entries


def _lerf_mask(folder: Path, photos: _Photos) -> _Read:
    masks = _below(folder, "test_mask")
    views = _view_folders(masks, "test_mask/VIEW/PROMPT.png")
    images, train = _stems(masks.parent / "images"), _stems(masks.parent / "images_train")
    counted = None
    if train is not None:
        names = images if images is not None else [Path(name).with_suffix("").as_posix() for name in photos.names]
        counted = [name for name in names if name not in train]
    how = "They count the pictures that are not in images_train: put that folder beside test_mask, as it is shipped."
    found = photos.of_views(views, counted, how)
    prompts = sorted({file.stem for view in views for file in view.glob("*.png")})
    return _Read({photo: _deferred(_white_pictures, view) for photo, view in found.items()}, prompts)


def _three_d_ovs(folder: Path, photos: _Photos) -> _Read:
    masks = _below(folder, "segmentations")
    listed = masks / "classes.txt"
    if not listed.is_file():
        raise FormatError(f"{listed} is missing: 3D-OVS lists there what its masks are called, one a line.")
    text = read_text(listed, advice="3D-OVS lists there what its masks are called, one a line.")
    classes = sorted({line.strip() for line in text.splitlines() if line.strip()})
    if not all(is_inner_name(f"{name}.png") for name in classes):
        raise FormatError(f"{listed} has a line that is not the name of a file. Write the name of one class a line.")
    views = _view_folders(masks, "segmentations/VIEW/CLASS.png")
    for view in views:
        missing = [name for name in classes if not (view / f"{name}.png").is_file()]
        if missing:
            raise FormatError(f"{view / missing[0]}.png is missing, but {listed} lists it. Every view has every class.")
    images = _stems(masks.parent / "images")
    counted = images if images is not None else [Path(name).with_suffix("").as_posix() for name in photos.names]
    found = photos.of_views(views, counted, "They count the scene's pictures: put images/ beside segmentations/.")

    def read(view: Path) -> dict[str, Mask]:
        return {name: _picture(view / f"{name}.png", "white") for name in classes}

    return _Read({photo: _deferred(read, view) for photo, view in found.items()}, classes)


def _lerf_ovs(folder: Path, photos: _Photos) -> _Read:
    found: dict[str, Callable[[], dict[str, Mask]]] = {}
    prompts: set[str] = set()
    for file in sorted(folder.glob("*.json")):
        data = read_json(
            file,
            _LABEL,
            advice="A label of LERF-OVS has `info` with name, width and height, and `objects` with category and "
            "segmentation.",
        )
        polygons = [(thing["category"], _corners(thing["segmentation"], file)) for thing in data["objects"]]
        size = (data["info"]["height"], data["info"]["width"])
        n_masks = max(1, len({category for category, _ in polygons}))
        if min(size) < 1 or size[0] * size[1] * n_masks > _MAX_MASK_PIXELS:
            raise FormatError(f"{file} cannot be read: {n_masks} masks of {size[1]} x {size[0]} pixels are too large.")
        view = PurePath(data["info"]["name"]).stem
        prompts.update(category for category, _ in polygons)
        found[photos.called(view)] = _deferred(_filled, (size, polygons))
    if not found:
        raise FormatError(f"{folder} holds no JSON label. Name the folder of one scene, label/SCENE.")
    return _Read(found, sorted(prompts))


def _corners(segmentation: list[Any], file: Path) -> NDArray[np.int32]:
    """Return the corners of a polygon, whole pixels [n, 2]."""
    try:
        corners = np.asarray(segmentation, np.float64).reshape(-1, 2)
    except (TypeError, ValueError, OverflowError) as error:
        raise FormatError(f"{file} cannot be read: a segmentation is not a list of points.") from error
    if not (np.abs(corners) <= _MAX_COORDINATE).all():
        raise FormatError(f"{file} cannot be read: a segmentation has a point that is not in a picture.")
    return corners.astype(np.int32)


def _filled(labels: tuple[tuple[int, int], list[tuple[str, NDArray[np.int32]]]]) -> dict[str, Mask]:
    size, polygons = labels
    drawn: dict[str, NDArray[np.uint8]] = {}
    for category, corners in polygons:
        picture = drawn.setdefault(category, np.zeros(size, np.uint8))
        if len(corners):
            cv2.fillPoly(picture, [corners], 1)
    return {category: picture > 0 for category, picture in drawn.items()}


def _white_pictures(view: Path) -> dict[str, Mask]:
    return {file.stem: _picture(file, "white") for file in sorted(view.glob("*.png"))}


def _deferred(read: Callable[[Any], dict[str, Mask]], what: object) -> Callable[[], dict[str, Mask]]:
    return lambda: read(what)


def _view_folders(masks: Path, form: str) -> list[Path]:
    views = sorted(path for path in masks.iterdir() if path.is_dir() and any(path.glob("*.png")))
    if not views:
        raise FormatError(f"{masks} holds no masks of the form {form}.")
    return views


def _stems(folder: Path) -> list[str] | None:
    """Return the names without extension of the pictures in `folder`, in order; None without the folder."""
    if not folder.is_dir():
        return None
    extensions = (".jpg", ".jpeg", ".png", ".webp", ".tif", ".tiff")
    return sorted(path.stem for path in folder.iterdir() if path.suffix.lower() in extensions)


def _picture(file: Path, what: Literal["ids", "white"]) -> NDArray[Any]:
    """Return the ids of a picture, int32 [h, w], or the pixels lighter than 128, as the benchmarks define masks."""
    from PIL import Image

    try:
        with opened(file, advice="Replace the mask.") as stream, Image.open(stream) as picture:
            if picture.width * picture.height > _MAX_PIXELS:
                raise MaskError(f"The mask {file} cannot be read: it has {picture.width} x {picture.height} pixels.")
            values = np.empty((picture.height, picture.width), bool if what == "white" else np.int32)
            # In strips, because the conversion of a whole picture copies it several times.
            for top in range(0, picture.height, _STRIP_ROWS):
                strip = picture.crop((0, top, picture.width, min(top + _STRIP_ROWS, picture.height)))
                rows = np.asarray(strip.convert("L")) > 128 if what == "white" else np.asarray(strip)
                if rows.ndim != 2:
                    raise MaskError(f"{file} is a colour picture; instance ids are one number per pixel.")
                values[top : top + _STRIP_ROWS] = rows
            return values
    except FormatError as error:
        raise MaskError(str(error)) from error
    except HeritageError:
        raise
    except Exception as error:  # Pillow raises exceptions of many types on damaged data
        raise MaskError(f"The mask {file} cannot be read: {error}.") from error
