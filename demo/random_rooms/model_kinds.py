# SPDX-License-Identifier: GPL-3.0-or-later
"""Exhibits that other people modelled: which models of Sweet Home 3D's libraries are exhibits, and their words.

The table was written from the names and sizes in the libraries alone, before any of it was rendered.
"""

from __future__ import annotations

from collections import defaultdict
from pathlib import Path

import numpy as np

from .catalogue import EVERYDAY, Catalogue, Kind
from .models import Model, ModelError, read_models
from .stuffs import Rng, pick, uniform
from .things import Thing, hanging, standing

_LENGTHS = {"surface": (0.24, 0.45), "floor": (0.55, 0.95), "wall": (0.35, 0.6)}
"""Shortest and longest exhibit by its mount, in metres: others are scaled, as models of a thing are."""

_KINDS: dict[str, dict[str, tuple[str, ...]]] = {
    "surface": {
        "vase": ("Vase",), "teapot": ("Teapot",), "mug": ("Coffee mug",), "bowl": ("Bowl", "Bowl with fruits"),
        "wine bottle": ("Wine bottle",), "beer glass": ("Beer glass",), "desk lamp": ("Desk lamp",),
        "table lamp": ("Little lamp",), "lantern": ("Japanese lantern",), "candle": ("Candle",),
        "teddy bear": ("Teddy bear",), "rocking horse": ("Rocking horse",), "dog": ("Dog", "Bulldog"),
        "cat": ("Cat", "Siamese cat"), "rabbit": ("Rabbit",), "hen": ("Chicken",), "doll": ("Doll",),
        "snowman": ("Snowman",), "toy train": ("Toy train",), "biplane": ("Biplane",), "doll house": ("Doll house",),
        "car": ("Car model",), "motorcycle": ("Motorbike",), "bicycle": ("Bike",), "basketball": ("Basketball",),
        "soccer ball": ("Soccer ball",), "toaster": ("Toaster",), "microwave": ("Microwave",),
        "coffee maker": ("Coffee brewer", "Coffee maker"), "mixer": ("Mixer",), "kitchen scale": ("Kitchen scale",),
        "laptop": ("Laptop", "Apple iBook"), "computer": ("Apple iMac 1998",), "radio": ("Radio",),
        "television": ("TV", "TV 16:9"), "telephone": ("Phone",), "fan": ("Table fan", "Rigged fan"),
        "loudspeaker": ("Speaker",), "printer": ("Inkjet printer and scanner",), "backpack": ("Backpack",),
        "handbag": ("Handbag",), "briefcase": ("Briefcase",), "suitcase": ("Suitcase",), "cactus": ("Cactus",),
        "orchid": ("Orchids",), "tulips": ("Tulips",), "bonsai": ("Bonsai tree",), "helmet": ("Helmet",),
        "hat": ("Hat",), "sneakers": ("Sneakers",), "chessboard": ("Chessboard",), "xylophone": ("Xylophone",),
        "birthday cake": ("Birthday cake",), "gift": ("Gift",), "safe": ("Safe",), "skateboard": ("Skateboard",),
        "piano": ("Upright piano", "Grand piano"), "cuckoo clock": ("Cuckoo clock",),
    },
    "floor": {
        "barrel": ("Barrel",), "crate": ("Crate",), "fire extinguisher": ("Extinguisher",),
        "fire hydrant": ("Fire hydrant",), "chair": ("Oak chair", "Chair with cushion"), "armchair": ("Armchair",),
        "mailbox": ("Mailbox",), "wheelbarrow": ("Wheelbarrow",),
        "trash can": ("Residential trashcan", "Park trashcan"), "washing machine": ("Washing machine",),
        "wheelchair": ("Wheelchair",), "tricycle": ("Tricycle",), "electric guitar": ("Electric guitar",),
        "traffic cone": ("Cone",),
    },
    "wall": {"dartboard": ("Dart game",)},
}  # fmt: skip
"""Names in the libraries by mount and word."""

_ALIKE = (
    ("vase", "teapot", "mug", "bowl", "wine bottle", "beer glass", "urn"),
    ("desk lamp", "table lamp", "lantern", "candle"),
    ("teddy bear", "doll", "snowman"),
    ("rocking horse", "horse", "dog", "cat", "rabbit", "hen"),
    ("toy train", "car", "truck"),
    ("motorcycle", "bicycle", "tricycle", "wheelchair", "wheelbarrow", "skateboard"),
    ("biplane", "airplane"),
    ("basketball", "soccer ball", "ball"),
    ("toaster", "microwave", "coffee maker", "mixer", "kitchen scale", "washing machine", "refrigerator", "printer"),
    ("laptop", "computer", "television", "telephone", "radio", "loudspeaker", "safe"),
    ("backpack", "handbag", "briefcase", "suitcase", "gift"),
    ("cactus", "orchid", "tulips", "bonsai"),
    ("helmet", "hat"),
    ("chair", "armchair", "bench", "stool", "wheelchair"),
    ("barrel", "trash can", "fire hydrant", "fire extinguisher"),
    ("crate", "safe", "mailbox"),
    ("xylophone", "piano", "chessboard"),
    ("doll house", "cuckoo clock"),
)
"""Words that mean nearly the same, or whose things look much alike."""


def model_catalogue(folder: Path) -> Catalogue:
    """Return the kinds that the libraries of a folder hold.

    Raises
    ------
    ModelError
        When the folder holds no library, or not all kinds.
    """
    named: dict[str, list[Model]] = defaultdict(list)
    for model in read_models(folder):
        named[model.name].append(model)
    kinds = []
    for mount, words in _KINDS.items():
        for word, names in words.items():
            models = tuple(model for name in names for model in named[name])
            if not models:
                raise ModelError(f"The libraries of {folder} hold no {names[0]!r}. Use those of sweethome3d-furniture.")
            like = tuple(dict.fromkeys(other for group in _ALIKE if word in group for other in group if other != word))
            kinds.append(Kind(word, _Modelled(models, mount), mount, like))
    shown = {word for words in _KINDS.values() for word in words}
    return Catalogue(tuple(kinds), tuple(word for word in EVERYDAY if word not in shown))


class _Modelled:
    """Draws one of several models, and its size; arguments as of `Kind.draw`."""

    def __init__(self, models: tuple[Model, ...], mount: str) -> None:
        self._models, self._mount = models, mount

    def __call__(self, rng: Rng) -> Thing:
        model = pick(rng, self._models)
        shortest, longest = _LENGTHS[self._mount]
        length = max(model.size)
        scale = float(np.clip(length * uniform(rng, 0.9, 1.1), shortest, longest)) / length
        parts = model.parts(scale)
        return hanging(parts) if self._mount == "wall" else standing(parts)
