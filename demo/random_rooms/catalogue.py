# SPDX-License-Identifier: GPL-3.0-or-later
"""The catalogue of exhibits: builder, name, prompt and place of each kind, and words for what a room does not show."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property

from . import animal_kinds, box_kinds, figure_kinds, round_kinds, thin_kinds, vessel_kinds, wall_kinds
from .stuffs import Rng
from .things import Thing


@dataclass(frozen=True)
class Kind:
    """A kind of exhibit.

    Attributes
    ----------
    name
        Name of the exhibit, and the word that a curator types for it.
    draw
        Draws its sizes, shape, materials and colours.
    mount
        Where it may be: "surface" for plinths, tables and shelves, "floor", or "wall".
    like
        Words of kinds, of furniture or of neither that mean nearly the same, or whose objects look much alike.
    small
        Whether it is small enough to be put into another exhibit.
    """

    name: str
    draw: Callable[[Rng], Thing]
    mount: str = "surface"
    like: tuple[str, ...] = ()
    small: bool = False


KINDS: tuple[Kind, ...] = (
    Kind("vase", vessel_kinds.vase, like=("amphora", "urn", "pitcher", "jar", "flowerpot"), small=True),
    Kind("amphora", vessel_kinds.amphora, like=("vase", "urn", "pitcher", "jar")),
    Kind("urn", vessel_kinds.urn, like=("vase", "amphora", "jar", "goblet")),
    Kind("goblet", vessel_kinds.goblet, like=("urn",), small=True),
    Kind("bowl", vessel_kinds.bowl, like=("plate", "basket", "bucket")),
    Kind("teapot", vessel_kinds.teapot, like=("pitcher",), small=True),
    Kind("pitcher", vessel_kinds.pitcher, like=("vase", "amphora", "teapot", "bucket"), small=True),
    Kind("bell", vessel_kinds.bell, like=("gong",), small=True),
    Kind("hourglass", vessel_kinds.hourglass, like=("clock",)),
    Kind("drum", vessel_kinds.drum, like=("barrel", "gong")),
    Kind("barrel", vessel_kinds.barrel, "floor", like=("drum", "bucket")),
    Kind("flowerpot", vessel_kinds.flowerpot, like=("vase", "bucket")),
    Kind("bucket", round_kinds.bucket, like=("barrel", "basket", "flowerpot", "bowl", "pitcher")),
    Kind("table lamp", round_kinds.lamp, like=("lantern", "candelabrum")),
    Kind("globe", round_kinds.globe, like=("armillary sphere", "ball")),
    Kind("crown", round_kinds.crown, like=("helmet",)),
    Kind("helmet", round_kinds.helmet, like=("crown", "mask")),
    Kind("wheel", round_kinds.wheel),
    Kind("bottle", round_kinds.bottle, like=("jar",), small=True),
    Kind("jar", round_kinds.jar, like=("bottle", "vase", "amphora", "urn"), small=True),
    Kind("glass dome", round_kinds.dome, like=("bird", "jar")),
    Kind("ball", round_kinds.toy_ball, like=("globe",), small=True),
    Kind("chest", box_kinds.chest, "floor", like=("jewelry box", "crate")),
    Kind("jewelry box", box_kinds.jewelry_box, like=("chest", "crate")),
    Kind("book", box_kinds.book),
    Kind("radio", box_kinds.radio),
    Kind("birdhouse", box_kinds.birdhouse, like=("birdcage",)),
    Kind("crate", box_kinds.crate, like=("chest", "jewelry box", "basket")),
    Kind("toy blocks", box_kinds.toy_blocks),
    Kind("accordion", box_kinds.accordion),
    Kind("bust", figure_kinds.bust, like=("statuette", "mask")),
    Kind("statuette", figure_kinds.statuette, like=("bust", "totem pole", "elephant", "chess piece")),
    Kind("mask", figure_kinds.mask, like=("bust", "helmet")),
    Kind("teddy bear", animal_kinds.teddy, small=True),
    Kind("totem pole", animal_kinds.totem, "floor", like=("statuette",)),
    Kind("elephant", animal_kinds.elephant, like=("statuette",)),
    Kind("bird", animal_kinds.stuffed_bird, like=("glass dome", "birdcage")),
    Kind("chess piece", animal_kinds.chess_piece, like=("statuette",)),
    Kind("candelabrum", thin_kinds.candelabrum, like=("table lamp", "lantern")),
    Kind("birdcage", thin_kinds.birdcage, like=("birdhouse", "bird", "lantern")),
    Kind("basket", thin_kinds.basket, like=("bucket", "bowl", "crate")),
    Kind("chair", thin_kinds.chair, "floor", like=("bench", "stool")),
    Kind("harp", thin_kinds.harp, like=("violin",)),
    Kind("armillary sphere", thin_kinds.armillary, like=("globe",)),
    Kind("lantern", thin_kinds.lantern, like=("table lamp", "candelabrum", "birdcage")),
    Kind("sailing ship", thin_kinds.ship),
    Kind("gong", thin_kinds.gong, like=("bell", "drum")),
    Kind("easel", thin_kinds.easel, "floor", like=("painting",)),
    Kind("anchor", thin_kinds.anchor),
    Kind("shield", wall_kinds.shield, "wall", like=("plate",)),
    Kind("painting", wall_kinds.painting, "wall", like=("easel", "banner", "information panel")),
    Kind("clock", wall_kinds.clock, "wall", like=("hourglass",)),
    Kind("plate", wall_kinds.plate, "wall", like=("shield", "bowl")),
    Kind("violin", wall_kinds.violin, "wall", like=("harp",)),
    Kind("sword", wall_kinds.sword, "wall"),
)

KIND_OF = {kind.name: kind for kind in KINDS}

EVERYDAY = (
    "dog",
    "car",
    "laptop",
    "banana",
    "bicycle",
    "refrigerator",
    "sneaker",
    "airplane",
    "horse",
    "toaster",
    "television",
    "backpack",
    "washing machine",
    "pizza",
    "motorcycle",
    "cat",
    "telephone",
    "microwave",
    "skateboard",
    "traffic light",
)
"""Words for things that no room shows."""


@dataclass(frozen=True)
class Catalogue:
    """What exhibits are drawn from.

    Attributes
    ----------
    kinds
        Kinds of exhibits.
    everyday
        Words for things that no room of these kinds shows.
    holders
        Names of kinds with a cavity that takes a small exhibit, where nothing that was drawn has one.
    """

    kinds: tuple[Kind, ...]
    everyday: tuple[str, ...]
    holders: tuple[str, ...] = ()

    @cached_property
    def kind_of(self) -> dict[str, Kind]:
        """The kinds by their names."""
        return {kind.name: kind for kind in self.kinds}


OWN = Catalogue(KINDS, EVERYDAY, ("bowl", "bucket", "crate", "basket"))
"""The kinds that this folder draws."""
