"""The report as one HTML page that loads no other file."""

from __future__ import annotations

import base64
import html
import io
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from .plots import error_curve
from .style import STYLE
from .views import PhotoPair

__all__ = ["Pictures", "page"]

_STAGE_NAMES = {
    "photos": "Reading the photos",
    "cameras": "Finding the cameras",
    "masks": "Segmenting the photos",
    "training": "Training the Gaussians",
    "objects": "Isolating objects",
    "report": "Writing this report",
}
_GUARD_NAMES = {
    "refused_steps": "training steps skipped because a gradient was not finite",
    "gaussians_not_updated": "updates of single Gaussians skipped because a gradient was not finite",
    "clamped_positions": "positions clamped to the scene",
    "reset_rotations": "rotations of length zero reset",
}
_LIMIT_NAMES = {
    "scales_at_limit": "at the largest elongation (1:50) or the smallest or largest size",
    "opacities_at_limit": "at the lowest or highest opacity",
}


@dataclass(frozen=True)
class Pictures:
    """Pictures of the page.

    Attributes
    ----------
    held_out : dict of str to PhotoPair
        Pairs by photo name.
    objects : dict of str to list of uint8 arrays [H, W, 3]
        Pictures by object id.
    """

    held_out: dict[str, PhotoPair] = field(default_factory=dict)
    objects: dict[str, list[NDArray[np.uint8]]] = field(default_factory=dict)


def page(facts: dict[str, Any], pictures: Pictures) -> str:
    """Return the page as HTML text.

    Parameters
    ----------
    facts : dict
        As returned by `collect_facts`.
    pictures : Pictures

    Returns
    -------
    str
    """
    parts = (
        _head(facts),
        _objects(facts, pictures),
        _held_out(facts, pictures),
        _curve(facts),
        _stages(facts),
        _plan(facts),
        _photos(facts),
        _left_out(facts),
        _guards(facts),
        _software(facts),
    )
    title = html.escape(str(facts["title"]))
    return (
        f'<!doctype html>\n<html lang="en"><head><meta charset="utf-8">'
        f'<meta name="viewport" content="width=device-width, initial-scale=1"><title>{title}</title>'
        f"<style>{STYLE}</style></head><body><main>{''.join(parts)}</main></body></html>\n"
    )


def _head(facts: dict[str, Any]) -> str:
    training, cameras = facts["training"], facts["cameras"]
    last = (training.get("curve") or [{}])[-1]
    tiles = [
        ("photos used", _count(cameras.get("n_registered"))),
        ("Gaussians", _count(training.get("n_gaussians") or last.get("n_gaussians"))),
        ("object" if len(facts["objects"]) == 1 else "objects", _count(len(facts["objects"]))),
        (
            "PSNR on held-out photos" if training.get("held_out") else "PSNR",
            _number(last.get("psnr"), "{:.1f} dB"),
        ),
        ("SSIM", _number(last.get("ssim"), "{:.3f}")),
        ("total run time", _duration(sum(stage["wall_seconds"] for stage in facts["stages"]))),
    ]
    shown = "".join(f"<div><b>{value}</b><span>{name}</span></div>" for name, value in tiles if value)
    waiting = [_STAGE_NAMES[stage].lower() for stage in facts["not_done"] if stage not in ("objects", "masks")]
    note = f'<p class="note">Not done yet: {", ".join(waiting)}.</p>' if waiting else ""
    return (
        f"<header><p>Gaussian Heritage report</p><h1>{html.escape(str(facts['title']))}</h1></header>"
        f'<div class="tiles">{shown}</div>{note}'
    )


def _objects(facts: dict[str, Any], pictures: Pictures) -> str:
    cards = []
    for record in facts["objects"]:
        sides = pictures.objects.get(record["id"], [])
        images = "".join(_image(side, f"{record['name']}, side {i}") for i, side in enumerate(sides, start=1))
        seeds = len({seed["photo"] for seed in record["seeds"]})
        details = (
            f"{_describe_prompt(record['prompt'])}; {_count(record['n_gaussians'])} Gaussians; "
            f"confidence {record['score']:.2f}; "
            f"agreement with its mask {record['fit']:.2f}; "
            f"seen in {seeds} photo{'s' if seeds != 1 else ''}; {record['seconds']:.0f} s"
        )
        cards.append(
            f'<article><h3>{html.escape(record["name"])}</h3><div class="sides">{images}</div>'
            f"<p>{html.escape(details)}</p></article>"
        )
    refused = "".join(f"<li>{html.escape(str(reason))}</li>" for reason in facts["refused_prompts"].values())
    if refused:
        cards.append(f"<h3>Not found</h3><ul>{refused}</ul>")
    return _section("Objects", "".join(cards) or "<p>No object was isolated yet.</p>")


def _describe_prompt(prompt: dict[str, Any]) -> str:
    if prompt.get("kind") == "text":
        return f"prompt “{prompt['text']}”"
    return f"selected by {prompt.get('kind', 'hand')} in {prompt.get('photo', 'a photo')}"


def _held_out(facts: dict[str, Any], pictures: Pictures) -> str:
    if not pictures.held_out:
        return ""
    rows = "".join(
        f"<figure>{_image(pair.photo, 'photo')}{_image(pair.render, 'render')}"
        f"<figcaption>{html.escape(name)}: the photo, and the scene rendered from its camera</figcaption></figure>"
        for name, pair in pictures.held_out.items()
    )
    kept = facts["training"].get("held_out")
    text = (
        "These photos were never trained on: the second picture of each pair is a new view for the scene."
        if kept
        else "There were too few photos to hold one out; these were trained on."
    )
    return _section("Photo and scene", f'<p>{text}</p><div class="pairs">{rows}</div>')


def _curve(facts: dict[str, Any]) -> str:
    training = facts["training"]
    svg = error_curve(training.get("curve") or [])
    if not svg:
        return ""
    table = [
        ("steps", _count((training.get("curve") or [{}])[-1].get("step"))),
        ("time per step", _number(training.get("step_ms"), "{:.0f} ms")),
        ("preset", html.escape(str(training.get("preset") or ""))),
    ]
    agreement = training.get("feature_agreement")
    if agreement:
        trained, untrained = (
            _number(agreement.get("trained"), "{:.2f}"),
            _number(agreement.get("untrained"), "{:.2f}"),
        )
        table.append(("segments of held-out photos reproduced by features (IoU)", f"{trained} (untrained {untrained})"))
    text = "Error on photos that were not trained on, over run time." if training.get("held_out") else ""
    return _section("Error against run time", f'<p>{text}</p><div class="plot">{svg}</div>{_pairs(table)}')


def _stages(facts: dict[str, Any]) -> str:
    rows = [
        (_STAGE_NAMES[stage["stage"]], _duration(stage["wall_seconds"]), _duration(stage["cpu_seconds"]))
        for stage in facts["stages"]
    ]
    if not rows:
        return ""
    total = tuple(_duration(sum(stage[key] for stage in facts["stages"])) for key in ("wall_seconds", "cpu_seconds"))
    body = "".join(f"<tr><td>{a}</td><td>{b}</td><td>{c}</td></tr>" for a, b, c in rows)
    return _section(
        "Time",
        f"<table><thead><tr><th>stage</th><th>wall</th><th>CPU</th></tr></thead><tbody>{body}</tbody>"
        f"<tfoot><tr><td>total</td><td>{total[0]}</td><td>{total[1]}</td></tr></tfoot></table>",
    )


def _photos(facts: dict[str, Any]) -> str:
    photos, cameras = facts["photos"], facts["cameras"]
    table = [
        ("readable photos", _count(photos.get("n_photos"))),
        ("registered", _count(cameras.get("n_registered"))),
        ("reprojection error", _number(cameras.get("reprojection_error"), "{:.2f} px")),
        ("camera poses", "given" if cameras.get("poses_given") else "estimated" if cameras else ""),
        ("photos with segments", _count(facts["masks"].get("n_photos"))),
        ("time per segmented photo", _number(facts["masks"].get("seconds_per_photo"), "{:.1f} s")),
    ]
    rejected = [f"<b>{html.escape(p['name'])}</b> {html.escape(p['reason'])}" for p in photos.get("rejected", ())]
    unplaced = [html.escape(name) for name in cameras.get("unregistered", ())]
    return _section(
        "Photos",
        _pairs(table)
        + _list("Not used", rejected, "Every photo was used.")
        + _list("Not registered", unplaced, "Every photo was registered."),
    )


def _plan(facts: dict[str, Any]) -> str:
    """Return the plan, and the forecast with the actual cost."""
    plan, training = facts["plan"], facts["training"]
    if not plan:
        return ""
    pairs = {"none": "none", "all": "all", "promising": "promising ones, about"}[plan["pairs"]]
    table = [
        ("training pictures", f"{plan['width']} x {plan['height']}"),
        ("pairs matched", f"{pairs} {_count(plan['n_pairs'])}" if plan["n_pairs"] else pairs),
        ("photos with segments", _count(plan["n_mask_photos"])),
        ("maximum number of Gaussians", _count(plan["max_gaussians"])),
        ("degree of spherical harmonics", f"{training.get('sh_degree', plan['sh_degree'])} of {plan['sh_degree']}"),
        ("segmentation features", "yes" if plan["features"] else "no"),
        ("brightness correction per photo", "yes" if "exposure" in training else "no"),
        ("maximum number of steps", _count(plan["steps"])),
    ]
    return _section("Plan and forecast", _pairs(table) + _forecast(facts["forecast"]))


def _forecast(rows: list[dict[str, Any]]) -> str:
    if not rows:
        return ""
    body = "".join(
        f"<tr><td>{_STAGE_NAMES[row['stage']]}</td>"
        f"<td>{_duration(row['seconds'])} ({_duration(row['low'])} to {_duration(row['high'])})</td>"
        f"<td>{_actual_time(row)}</td>"
        f"<td>{_memory(row['memory'])} ({_memory(row['memory_low'])} to {_memory(row['memory_high'])})</td>"
        f"<td>{_memory(row['actual_memory'])}</td></tr>"
        for row in rows
    )
    return (
        "<p>Forecast before the run, with the range in which 8 of 10 runs are expected, and the actual cost.</p>"
        "<table><thead><tr><th>stage</th><th>time, forecast</th><th>actual</th><th>memory, forecast</th>"
        f"<th>actual peak</th></tr></thead><tbody>{body}</tbody></table>"
    )


def _actual_time(row: dict[str, Any]) -> str:
    if row["actual_seconds"] is None:
        return "not done yet" if row["stage"] != "report" else "being written"
    return _duration(row["actual_seconds"]) + (" (continued)" if row["continued"] else "")


def _memory(value: Any) -> str:
    return f"{value / 1e9:.2f} GB" if isinstance(value, int | float) else "unknown"


def _left_out(facts: dict[str, Any]) -> str:
    items = [
        f"<b>{html.escape(item['what'])}</b>: {html.escape(item['why'])}. "
        f'<span class="small">Saved: {html.escape(item.get("saved") or "not measured")}.</span>'
        for item in facts["left_out"]
    ]
    return _section("What was left out", _list("", items, "Nothing was left out.") + _savings(facts))


def _savings(facts: dict[str, Any]) -> str:
    saved = facts["measured_savings"]
    if not saved:
        return ""
    masks = f" and {saved['mask_cpu_seconds']:.0f} CPU s of masks" if "mask_cpu_seconds" in saved else ""
    return (
        f"<p>Measured against a run of the same preset with nothing left out: {saved['training_cpu_seconds']:.0f} CPU "
        f"s of training{masks} saved, at {saved['psnr_lost']:.2f} dB less on held-out photos.</p>"
    )


def _guards(facts: dict[str, Any]) -> str:
    fired = {name: n for name, n in (facts["training"].get("guards") or {}).items() if n}
    items = [
        f"<b>{_count(n)}</b> {html.escape(_GUARD_NAMES.get(name, name.replace('_', ' ')))}" for name, n in fired.items()
    ]
    return _section(
        "Numerical problems",
        _list("", items, "None: all numbers stayed finite and within bounds.") + _limits(facts),
    )


def _limits(facts: dict[str, Any]) -> str:
    """Return how many Gaussians the limits of the method clamped on average. That is normal and no problem."""
    training = facts["training"]
    limits, steps = training.get("limits") or {}, training.get("steps") or 0
    clamped = [
        f"{_count(round(limits[name] / steps))} {description}"
        for name, description in _LIMIT_NAMES.items()
        if steps and name in limits
    ]
    if not clamped:
        return ""
    return (
        f'<p class="small">As in every run, limits of the method clamped some Gaussians. On average over the steps: '
        f"{', '.join(clamped)}; of {_count(training.get('n_gaussians'))} at the end.</p>"
    )


def _software(facts: dict[str, Any]) -> str:
    machine = facts["machine"]
    versions = ", ".join(f"{html.escape(name)} {html.escape(version)}" for name, version in facts["software"].items())
    return _section(
        "Software",
        f'<p class="small">{versions}. {html.escape(machine["system"])}, {html.escape(machine["processor"])}, '
        f"{machine['cores']} cores.</p>",
    )


def _section(title: str, content: str) -> str:
    return f"<section><h2>{title}</h2>{content}</section>"


def _list(title: str, items: Sequence[str], otherwise: str) -> str:
    heading = f"<h3>{title}</h3>" if title and items else ""
    return f"{heading}<ul>{''.join(f'<li>{item}</li>' for item in items)}</ul>" if items else f"<p>{otherwise}</p>"


def _pairs(rows: Iterable[tuple[str, str]]) -> str:
    shown = "".join(f"<div><dt>{name}</dt><dd>{value}</dd></div>" for name, value in rows if value)
    return f"<dl>{shown}</dl>" if shown else ""


def _image(pixels: NDArray[np.uint8], text: str) -> str:
    from PIL import Image

    buffer = io.BytesIO()
    Image.fromarray(pixels).save(buffer, format="JPEG", quality=86)
    data = base64.b64encode(buffer.getvalue()).decode("ascii")
    height, width = pixels.shape[:2]
    return (
        f'<img loading="lazy" width="{width}" height="{height}" alt="{html.escape(text)}" '
        f'src="data:image/jpeg;base64,{data}">'
    )


def _count(value: Any) -> str:
    # A narrow no-break space separates thousands in every language.
    return f"{int(value):,}".replace(",", "\u202f") if isinstance(value, int | float) and np.isfinite(value) else ""


def _number(value: Any, form: str) -> str:
    return form.format(value) if isinstance(value, int | float) and np.isfinite(value) else ""


def _duration(seconds: float) -> str:
    if seconds < 10:
        return f"{seconds:.1f} s"
    if seconds < 100:
        return f"{seconds:.0f} s"
    minutes = int(round(seconds / 60))
    return f"{minutes} min" if minutes < 60 else f"{minutes // 60} h {minutes % 60:02d} min"
