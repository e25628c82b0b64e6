"""Miniatures of the layouts that true masks are shipped in, made from the museum room's."""

from __future__ import annotations

import json
import shutil
from collections.abc import Sequence
from pathlib import Path

import cv2
import numpy as np
from PIL import Image

from tests.engine.museum import ROOM

NAMES = {2: "teapot", 1: "vase"}
SIZE = (200, 150)


def photo(view: int) -> str:
    return f"view_{view:02}.jpg"


def true_masks(view: int) -> dict[str, np.ndarray]:
    """The masks of the vase and the teapot in a view, a quarter of the photo's size."""
    with Image.open(ROOM / "truth" / "masks" / f"view_{view:02}.png") as picture:
        ids = np.asarray(picture.resize(SIZE, Image.Resampling.NEAREST))
    return {name: ids == number for number, name in NAMES.items()}


def as_museum(folder: Path, views: Sequence[int]) -> Path:
    (folder / "masks").mkdir(parents=True)
    for view in views:
        shutil.copy(ROOM / "truth" / "masks" / f"view_{view:02}.png", folder / "masks")
    shutil.copy(ROOM / "truth" / "names.json", folder)
    return folder


def as_lerf_mask(folder: Path, views: Sequence[int], train: Sequence[int]) -> Path:
    """Like Gaussian Grouping's: the views count the pictures that are not in ``images_train``."""
    for name, content in (("images", [*views, *train]), ("images_train", train)):
        (folder / name).mkdir(parents=True)
        for view in content:
            (folder / name / photo(view)).touch()
    for number, view in enumerate(sorted(views)):
        _white(
            folder / "test_mask" / str(number), {name: mask for name, mask in true_masks(view).items() if mask.any()}
        )
    return folder


def as_3d_ovs(folder: Path, views: Sequence[int], images: Sequence[int]) -> Path:
    """Like 3D-OVS: the views count all pictures, and every view has every class, black where it is not seen."""
    for view in views:
        _white(folder / "segmentations" / f"{sorted(images).index(view):02}", true_masks(view))
    (folder / "segmentations" / "classes.txt").write_text("vase\nteapot\n", encoding="utf-8")
    return folder


def as_lerf_ovs(folder: Path, views: Sequence[int]) -> Path:
    """Like LangSplat's ``label/<scene>``: polygons, one of them cut in two of one category."""
    folder.mkdir(parents=True)
    for view in views:
        objects = []
        for category, mask in true_masks(view).items():
            for half in (mask & (np.arange(SIZE[0]) < SIZE[0] // 2), mask & (np.arange(SIZE[0]) >= SIZE[0] // 2)):
                contours = cv2.findContours(half.astype(np.uint8), cv2.RETR_EXTERNAL, cv2.CHAIN_APPROX_NONE)[0]
                objects += [
                    {"category": category, "segmentation": c[:, 0].tolist(), "bbox": [0, 0, 1, 1]} for c in contours
                ]
        info = {"name": photo(view), "width": SIZE[0], "height": SIZE[1]}
        (folder / f"view_{view:02}.json").write_text(json.dumps({"info": info, "objects": objects}), encoding="utf-8")
    return folder


def _white(folder: Path, masks: dict[str, np.ndarray]) -> None:
    folder.mkdir(parents=True)
    for name, mask in masks.items():
        Image.fromarray(np.where(mask, np.uint8(255), np.uint8(0))).save(folder / f"{name}.png")
