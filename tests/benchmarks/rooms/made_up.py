"""Small results that were never measured."""

from __future__ import annotations

from typing import Any


def measured(
    *, iou: float = 0.8, words: tuple[float, ...] = (0.9, 0.6, 0.0), psnr: float | None = 25.0, whole: bool = True
) -> dict[str, Any]:
    """Return what `benchmarks.rooms measure` writes: two objects, a word for each of `words`, two absent things."""
    masks = [{"object": name, "iou": iou, "boundary_iou": iou - 0.1} for name in ("vase", "bust")]
    found = [
        {"word": f"word {number}", "iou": one, "refused": one == 0.0, "wall": 1.0 + number, "cpu": 1.0}
        for number, one in enumerate(words)
    ]
    absent = [
        {"word": word, "refused": refused, "wall": 0.5, "cpu": 0.5} for word, refused in (("dog", True), ("car", False))
    ]
    objects = [masks[0], {"object": "bust", "iou": 0.1, "boundary_iou": 0.1}]
    methods = ("paper", "released", "better")
    return {
        "version": 1,
        "machine": {"cores": 2, "system": "Linux x86_64"},
        "n_gaussians": 15_000,
        "test_photos": ["view_04.jpg"],
        "test_psnr": psnr,
        "seconds": {"training": {"wall": 120.0, "cpu": 200.0, "whole": whole}},
        "mask": dict.fromkeys(methods, masks),
        "click": dict.fromkeys(methods, objects),
        "text": {method: {"words": found, "absent": absent} for method in methods},
        "ceiling": {"word 0": "word 0", "word 1": "word 0", "word 2": "word 2"},
        "all": {"better": {"objects": objects, "n_false": 3, "n_results": 9, "wall": 60.0, "cpu": 90.0}},
    }
