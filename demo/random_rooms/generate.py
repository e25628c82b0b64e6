# SPDX-License-Identifier: GPL-3.0-or-later
"""Command line, files and rendering of a random room."""

from __future__ import annotations

import argparse
import time
from pathlib import Path

import numpy as np
from studio import shoot
from studio.phone import Phone, save_ids
from studio.stage import lamp, sky
from studio.views import useful_order

# `studio.shoot` gives bpy its settings, so it is imported before.
import bpy  # isort: skip

from .build import Workshop
from .catalogue import OWN, Catalogue
from .colmap_text import model_files
from .model_kinds import model_catalogue
from .models import ModelError
from .outputs import ROOM_FILE, OtherRoomError, accepted_attempt, is_complete
from .plan import (
    ATTEMPTS_PER_SET,
    FIRST_FURNITURE,
    PHONE,
    SEEN_PHOTOS,
    SEEN_PIXELS,
    RoomError,
    RoomPlan,
    draw_room,
    generator,
    new_seed,
)

ATTEMPTS = 10 * ATTEMPTS_PER_SET
"""Layouts whose masks are rendered before the seed is given up."""
SAMPLES = 6


def main(description: str | None) -> int:
    """Parse the command line, create what is missing of a room, and return the exit code."""
    parser = argparse.ArgumentParser(description=description)
    parser.add_argument("--seed", type=int, required=True, help="what the room is drawn from; not negative")
    parser.add_argument("--out", type=Path, required=True, help="folder for photos/, truth/ and cameras/")
    parser.add_argument(
        "--models",
        type=Path,
        help="folder of *.sh3f files of Sweet Home 3D, whose models are the exhibits; see README.md",
    )
    parser.add_argument("--scale", type=int, default=1, help="times the size of the photos (default: 1)")
    arguments = parser.parse_args()
    if arguments.seed < 0:
        parser.error("--seed must not be negative")
    if arguments.scale < 1:
        parser.error(f"--scale must be at least 1, got {arguments.scale}")
    try:
        catalogue = OWN if arguments.models is None else model_catalogue(arguments.models)
        make_room(arguments.seed, arguments.out, PHONE.scaled(arguments.scale), catalogue)
    except (ModelError, OtherRoomError, RoomError) as error:
        parser.error(str(error))
    return 0


def make_room(seed: int, out: Path, phone: Phone, catalogue: Catalogue) -> None:
    """Create the missing files of a room. Which layout is accepted does not depend on the size of its photos.

    Raises
    ------
    OtherRoomError
        When the folder holds another room, or photos of another size.
    RoomError
        When no room was found for the seed.
    """
    family = "own" if catalogue is OWN else "models"
    attempt = accepted_attempt(out, seed, family)
    photos, masks = shoot.prepare_folders(out)
    plan, ids = (draw_room(seed, attempt, catalogue), None) if attempt is not None else _accepted(seed, catalogue)
    truth = out / "truth"
    try:
        shoot.write_truth(plan.views, plan.named(), phone, truth)
    except FileExistsError as error:
        raise OtherRoomError(f"{error}.") from error
    if attempt is not None and is_complete(out):
        print(f"{out} is complete.")
        return
    shoot.write_json(truth / "absent.json", list(plan.absent))
    (out / "cameras").mkdir(exist_ok=True)
    for name, text in model_files(plan.views, phone).items():
        shoot.write_text(out / "cameras" / name, text)
    shoot.write_json(truth / ROOM_FILE, {"seed": seed, "attempt": plan.attempt, "exhibits": family})
    if ids is None or phone != PHONE:
        build(plan, phone)
        with shoot.mask_rendering():
            ids = {
                view.name: shoot.render_ids(view, phone)
                for view in plan.views
                if not (masks / f"{view.name}.png").exists()
            }
    for name, picture in ids.items():
        save_ids(picture, masks / f"{name}.png")
    _take_photos(plan, photos, phone)


def _accepted(seed: int, catalogue: Catalogue) -> tuple[RoomPlan, dict[str, np.ndarray]]:
    """Return the first plan whose rendered masks show every exhibit often enough, and the masks by view."""
    for attempt in range(ATTEMPTS):
        plan = draw_room(seed, attempt, catalogue)
        build(plan)
        with shoot.mask_rendering():
            ids = {view.name: shoot.render_ids(view, PHONE) for view in plan.views}
        poor = seen_too_little(plan, ids)
        if not poor:
            return plan, ids
        print(f"attempt {attempt}: seen too little: {', '.join(poor)}", flush=True)
    raise RoomError(f"No room of seed {seed} shows every exhibit in {SEEN_PHOTOS} photos, in {ATTEMPTS} attempts.")


def seen_too_little(plan: RoomPlan, ids: dict[str, np.ndarray]) -> list[str]:
    """Return the names of exhibits that fewer than `SEEN_PHOTOS` masks show with `SEEN_PIXELS`."""
    counts = np.array([np.bincount(picture.ravel(), minlength=256) for picture in ids.values()])
    seen = (counts >= SEEN_PIXELS).sum(axis=0)
    return [one.name for k, one in enumerate(plan.exhibits, start=1) if seen[k] < SEEN_PHOTOS]


def build(plan: RoomPlan, phone: Phone = PHONE) -> None:
    """Build a room in an empty scene, seen by `phone`."""
    bpy.ops.wm.read_factory_settings(use_empty=True)
    workshop = Workshop()
    workshop.build(plan.shell, "Room", (0.0, 0.0, 0.0), 0.0, 0)
    for start, things in ((1, plan.exhibits), (FIRST_FURNITURE, plan.furniture)):
        for identity, one in enumerate(things, start=start):
            workshop.build(one.thing, one.name, one.where, one.turn, identity)
    sky(*plan.sky)
    for k, one in enumerate(plan.lamps):
        lamp(f"Lamp {k}", one.where, one.aim, one.wide, one.tall, one.watts, one.colour)
    shoot.camera(phone)


def _take_photos(plan: RoomPlan, photos: Path, phone: Phone) -> None:
    shoot.setup_photos(SAMPLES, bounces=1)
    order = useful_order(len(plan.views))
    for done, index in enumerate(order, start=1):
        path = photos / f"{plan.views[index].name}.jpg"
        if not path.exists():
            started = time.perf_counter()
            seed = new_seed(generator(plan.seed, "render", index))
            pixels = shoot.render_photo(plan.views[index], phone, seed, (plan.seed, index))
            phone.save_photo(pixels, path, f"Random room {plan.seed}, synthetic, CC0")
            print(f"{path.name} {done}/{len(order)} {time.perf_counter() - started:.1f} s", flush=True)
