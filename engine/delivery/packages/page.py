"""A page that shows a scene or an object with its record: one HTML file, which opens from a disk without the web."""

from __future__ import annotations

import base64
import gzip
import hashlib
import json
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ...core.errors import EnvironmentProblem, FormatError
from ...core.files import TEMPORARY_PREFIX, delete_derived, read_bytes, read_text, write_file
from ...core.language import languages
from ...core.stage_names import STAGE_NAMES
from ...formats import write_ply
from ...scene import Gaussians, PinholeCamera, looked_at
from ..report import Html, fill, joined

_VIEWER = Path(__file__).resolve().parent / "viewer_files"
_ADVICE = "Run `make page` in the source code, or use a release that contains the page."
_MAX_BYTES = 400_000_000
"""Of a page. Chromium reads texts of at most 512 MB."""
_LEVEL = 6
"""Of gzip: higher ones save less than a hundredth of the size of Gaussians."""
_MAX_VIEWS = 8


@dataclass(frozen=True)
class Framing:
    """Where the page looks from.

    Attributes
    ----------
    center : list of 3 floats
        World units.
    radius : float
        Of the sphere that movements depend on.
    views : tuple of PinholeCamera
        The first is shown first.
    up : list of 3 floats
        Direction that is up.
    """

    center: list[float]
    radius: float
    views: tuple[PinholeCamera, ...]
    up: list[float]


@dataclass(frozen=True)
class Part:
    """An object of a scene, which the page can light and hide.

    Attributes
    ----------
    id, name : str
    members : bool array of shape [N]
        Which of the scene's Gaussians belong to it.
    """

    id: str
    name: str
    members: NDArray[np.bool_]


def is_viewer_built() -> bool:
    """Return whether this installation contains the viewer that pages need; a fresh checkout does not."""
    return (_VIEWER / "show.js").is_file()


def framing_of_object(gaussians: Gaussians, views: Sequence[PinholeCamera], up: list[float]) -> Framing:
    """Return the framing of an object of at least one Gaussian, seen from `views`, of which at most 8 are kept."""
    low, high = np.percentile(gaussians.means, [2, 98], axis=0)
    radius = max(float(np.linalg.norm(high - low)) / 2, 1e-6)
    return Framing(((low + high) / 2).tolist(), radius, _spread(views), up)


def framing_of_scene(views: Sequence[PinholeCamera], up: list[float]) -> Framing:
    """Return the framing of a scene, seen from the cameras `views`, at least one, of which at most 8 are kept."""
    center, radius = looked_at(np.array([view.viewmat for view in views]))
    return Framing(center, radius, _spread(views), up)


def _spread(views: Sequence[PinholeCamera]) -> tuple[PinholeCamera, ...]:
    count = min(len(views), _MAX_VIEWS)
    return tuple(views[i] for i in np.linspace(0, len(views), count, endpoint=False).astype(int))


def write_page(
    path: Path, gaussians: Gaussians, described: dict[str, Any], framing: Framing, parts: Sequence[Part] = ()
) -> None:
    """Write the page atomically.

    Parameters
    ----------
    gaussians : Gaussians
        In the world of the cameras, at least one.
    described : dict
        The record, as `describe_scene` or `describe_object` return it.
    parts : sequence of Part
        The objects of a scene.

    Raises
    ------
    EnvironmentProblem
        When the viewer was not built.
    FormatError
        When there are no Gaussians, or the page would be larger than browsers open.
    DiskError
        When it cannot be written.
    """
    if len(gaussians) == 0:
        raise FormatError(f"{described['title']} has no Gaussians, so there is nothing to show. Isolate it again.")
    if not is_viewer_built():
        raise EnvironmentProblem(f"The viewer of the page is missing in {_VIEWER}. {_ADVICE}")
    script, style = (read_text(_VIEWER / name, advice=_ADVICE) for name in ("show.js", "show.css"))
    viewer = read_bytes(_VIEWER / "viewer.js.gz", max_bytes=1 << 24, advice=_ADVICE)
    splats = gzip.compress(_ply_bytes(path, gaussians), _LEVEL, mtime=0)
    size = (len(viewer) + len(splats)) * 4 // 3
    if size > _MAX_BYTES:
        raise FormatError(
            f"A page with {len(gaussians)} Gaussians would have {size / 1e6:.0f} MB, and browsers open at most "
            f"{_MAX_BYTES / 1e6:.0f} MB. Export a single object, or another format."
        )
    text = fill(
        _PAGE,
        title=described["title"],
        policy=_policy(script),
        style=Html(style),
        names=_PART_NAMES,
        kind=_PART_NAMES["object" if "object" in described else "scene"],
        record=_record(described),
        captures=_captures(described),
        steps=_steps(described),
        licences=_lines(read_text(_VIEWER / "licences.txt", advice=_ADVICE)),
        data=_json({**_data(described, framing), "count": len(gaussians), "objects": [_part(one) for one in parts]}),
        viewer=_base64(viewer),
        splats=_base64(splats),
        script=Html(script),
    )
    write_file(path, text)


def _ply_bytes(path: Path, gaussians: Gaussians) -> bytes:
    """Return the Gaussians as a PLY file, which is written beside the page for that."""
    file = path.with_name(f"{TEMPORARY_PREFIX}{path.name}.ply")
    try:
        write_ply(file, gaussians)
        return read_bytes(file, max_bytes=1 << 33, advice="Export the scene as PLY.")
    finally:
        delete_derived(path.parent, file.name)


def _policy(script: str) -> str:
    """Return the content security policy: the page's own scripts alone, and nothing from the web."""
    digest = _base64(hashlib.sha256(script.encode()).digest())
    return (
        f"default-src 'none'; script-src 'sha256-{digest}' blob:; style-src 'unsafe-inline'; img-src data: blob:; "
        "connect-src data: blob:; worker-src blob:; base-uri 'none'; form-action 'none'"
    )


def _base64(data: bytes) -> Html:
    return Html(base64.b64encode(data).decode("ascii"))


def _data(described: dict[str, Any], framing: Framing) -> dict[str, Any]:
    return {
        "title": described["title"],
        "file": (described.get("object") or {}).get("id", "scene"),
        "unit": described["unit"]["text"],
        "metresPerUnit": described["unit"]["metres_per_unit"],
        "center": framing.center,
        "radius": framing.radius,
        "up": framing.up,
        "views": [_view(camera) for camera in framing.views],
        "languages": {language.code: {"texts": dict(language.texts), "sentences": {}} for language in languages()},
    }


def _part(part: Part) -> dict[str, str]:
    """Return an object with a bit for each Gaussian, the lowest of each byte first, with gzip in Base64."""
    bits = np.packbits(part.members, bitorder="little").tobytes()
    return {"id": part.id, "name": part.name, "members": str(_base64(gzip.compress(bits, _LEVEL, mtime=0)))}


def _view(camera: PinholeCamera) -> dict[str, Any]:
    K = camera.K
    return {
        **{"width": camera.width, "height": camera.height},
        **{"fx": float(K[0, 0]), "fy": float(K[1, 1]), "cx": float(K[0, 2]), "cy": float(K[1, 2])},
        "world_to_camera": np.asarray(camera.viewmat).ravel().tolist(),
    }


def _json(value: Any) -> Html:
    """Return JSON that cannot end the script element that it stands in."""
    return Html(json.dumps(value, allow_nan=False).replace("<", "\\u003c"))


def _record(described: dict[str, Any]) -> Html:
    item, exported = described.get("object") or {}, described["exported"]
    edits = item.get("hand_edits") or {}
    prompt = item.get("prompt") or {}
    rows = {
        "catalogue_number": item.get("catalogue_number"),
        "rights": item.get("rights"),
        "notes": item.get("notes"),
        "unit": described["unit"]["text"],
        "size": (described.get("size") or {}).get("text"),
        "scene": described.get("scene_title"),
        "prompt": prompt.get("text") or prompt.get("kind"),
        "confidence": _number(item.get("confidence")),
        "agreement": _number(item.get("agreement")),
        "corrections": edits.get("corrections"),
        "captures": sum(photo["use"] != "not used" for photo in described["captures"]) or None,
        "software": f"Gaussian Heritage {exported['software']['gaussian heritage']}",
        "commit": exported["commit"] and exported["commit"] + (" with changes" if exported["changed"] else ""),
        "finished": exported["finished"],
        "identifier": described["identifier"],
    }
    return joined(
        fill('<dt>{}</dt><dd class="{}">{}</dd>', _RECORD_NAMES[key], key, _lines(value))
        for key, value in rows.items()
        if value is not None
    )


def _lines(value: object) -> Html:
    """Return a text with its line breaks, which `fill` would show as escapes."""
    return joined((fill("{}", line) for line in str(value).splitlines()), "\n")


def _number(value: Any) -> str | None:
    return f"{value:.2f}" if isinstance(value, int | float) else None


def _captures(described: dict[str, Any]) -> Html:
    rows = joined(
        fill(
            "<tr><td>{}</td><td>{}</td><td>{}</td><td>{}</td></tr>",
            photo["name"],
            photo["use"],
            (photo.get("exif") or {}).get("taken", ""),
            " ".join(filter(None, ((photo.get("exif") or {}).get(key) for key in ("camera_make", "camera_model")))),
        )
        for photo in described["captures"]
    )
    head = joined(fill("<th>{}</th>", name) for name in _COLUMN_NAMES.values())
    return fill("<table><thead><tr>{}</tr></thead><tbody>{}</tbody></table>", head, rows)


def _steps(described: dict[str, Any]) -> Html:
    return joined(
        fill("<dt>{}</dt><dd>{}</dd>", STAGE_NAMES[step["stage"]], _step(step)) for step in described["steps"]
    )


def _step(step: dict[str, Any]) -> str:
    results = step["results"]
    parts = (
        step["finished"],
        step["commit"] and f"commit {step['commit']}{' with changes' if step['changed'] else ''}",
        None if step["seed"] is None else f"seed {step['seed']}",
        *(form.format(results[name]) for name, form in _RESULTS.items() if isinstance(results.get(name), int | float)),
    )
    return "; ".join(part for part in parts if part) or "No more is recorded."


_PART_NAMES = {
    "scene": "Scene",
    "object": "Object",
    "record": "Record",
    "steps": "How it was made",
    "captures": "Photographs",
    "licences": "Licences of the viewer",
}
_RECORD_NAMES = {
    "catalogue_number": "Catalogue number",
    "rights": "Rights",
    "notes": "Notes",
    "unit": "Unit of length",
    "size": "Size",
    "scene": "Part of",
    "prompt": "Isolated by",
    "confidence": "Confidence",
    "agreement": "Agreement with its mask",
    "corrections": "Corrections by hand",
    "captures": "Photographs",
    "software": "Made with",
    "commit": "Commit",
    "finished": "Written",
    "identifier": "Identifier",
}
_COLUMN_NAMES = {"name": "photograph", "use": "use", "taken": "taken", "camera": "camera"}
"""What the page's script shows in the language of the browser."""
_RESULTS = {
    "n_photos": "{} photographs",
    "n_registered": "{} placed",
    "reprojection_error": "reprojection error {:.2f} pixels",
    "n_gaussians": "{} Gaussians",
    "psnr": "PSNR {:.1f} dB on test photographs",
    "ssim": "SSIM {:.3f}",
    "confidence": "confidence {:.2f}",
    "agreement": "agreement with its mask {:.2f}",
}
"""Results that the page shows, with their form."""

_PAGE = """<!doctype html>
<html lang="en"><head><meta charset="utf-8">
<meta http-equiv="Content-Security-Policy" content="{policy}">
<meta name="viewport" content="width=device-width, initial-scale=1"><meta name="referrer" content="no-referrer">
<title>{title}</title><style>{style}</style></head><body>
<main><header><p>{kind}</p><h1>{title}</h1></header>
<div id="stage"><p>The 3D view needs JavaScript and WebGL 2.</p></div>
<section><h2>{names[record]}</h2><dl class="record">{record}</dl></section>
<section><h2>{names[steps]}</h2><dl class="record">{steps}</dl>
<details><summary>{names[captures]}</summary><div class="wide" tabindex="0">{captures}</div></details>
<details><summary>{names[licences]}</summary><pre tabindex="0">{licences}</pre></details></section></main>
<p id="announcements" class="hidden-text" aria-live="polite"></p>
<script type="application/json" id="data">{data}</script>
<script type="application/octet-stream" id="viewer">{viewer}</script>
<script type="application/octet-stream" id="splats">{splats}</script>
<script type="module">{script}</script>
</body></html>
"""
"""The page; its scripts read the elements ``data``, ``viewer`` and ``splats``."""
