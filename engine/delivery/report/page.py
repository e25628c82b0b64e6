"""The report as one HTML page that loads no other file."""

from __future__ import annotations

import base64
import io
from collections.abc import Iterable
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ...rasterizer import device_words
from .markup import Html, fill, joined
from .plots import error_curve
from .style import STYLE
from .views import PhotoPair

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

_BAD = ("yellow", "red")
"""Colours of the cameras' health whose sentence stands above everything else."""
_LOW_AGREEMENT = 0.8
"""Agreement with its mask below which an object is marked: museum_room has 0.74 to 0.98."""
_LOW = (
    '<p class="low">Low agreement with its mask: a part may be missing, or something else may belong to it. '
    "Look at it, and correct it with clicks.</p>"
)


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
        _record(facts),
    )
    return fill(
        '<!doctype html>\n<html lang="en"><head><meta charset="utf-8">'
        '<meta name="viewport" content="width=device-width, initial-scale=1"><title>{title}</title>'
        "<style>{style}</style></head><body><main>{parts}</main></body></html>\n",
        title=facts["title"],
        style=Html(STYLE),
        parts=joined(parts),
    )


def _head(facts: dict[str, Any]) -> Html:
    training, cameras = facts["training"], facts["cameras"]
    last = (training.get("curve") or [{}])[-1]
    tiles = [
        ("photos used", _count(cameras.get("n_registered"))),
        ("Gaussians", _count(training.get("n_gaussians") or last.get("n_gaussians"))),
        ("object" if len(facts["objects"]) == 1 else "objects", _count(len(facts["objects"]))),
        (
            "PSNR on test photos" if training.get("held_out") else "PSNR",
            _number(last.get("psnr"), "{:.1f} dB"),
        ),
        ("SSIM", _number(last.get("ssim"), "{:.3f}")),
        ("total run time", _duration(sum(stage["wall_seconds"] for stage in facts["stages"]))),
    ]
    health = cameras.get("health") or {}
    waiting = [_stage_name(stage).lower() for stage in facts["not_done"] if stage not in ("objects", "masks")]
    return fill(
        "<header><p>Gaussian Heritage report</p><h1>{title}</h1></header>"
        '{health}<div class="tiles">{tiles}</div>{note}',
        title=facts["title"],
        tiles=joined(fill("<div><b>{}</b><span>{}</span></div>", value, name) for name, value in tiles if value),
        health=fill('<p class="low">{}</p>', health["sentence"]) if health.get("colour") in _BAD else Html(),
        note=fill('<p class="note">Not done yet: {}.</p>', ", ".join(waiting)) if waiting else "",
    )


def _objects(facts: dict[str, Any], pictures: Pictures) -> Html:
    cards = []
    for record in facts["objects"]:
        sides = pictures.objects.get(record["id"], [])
        photos = len({one["photo"] for one in record["evidence"]})
        details = (
            f"{_describe_prompt(record['prompt'])}; {_count(record['n_gaussians'])} Gaussians; "
            f"confidence {record['score']:.2f}; "
            f"agreement with its mask {record['fit']:.2f}; "
            f"recognised in {photos} photo{'s' if photos != 1 else ''}, whose mask chose its Gaussians; "
            f"{record['seconds']:.0f} s"
        )
        cards.append(
            fill(
                '<article><h3>{name}</h3><div class="sides">{images}</div><p>{details}</p>{low}</article>',
                name=record["name"],
                images=joined(_image(side, f"{record['name']}, side {i}") for i, side in enumerate(sides, start=1)),
                details=details,
                low=fill(_LOW) if record["fit"] < _LOW_AGREEMENT else Html(),
            )
        )
    refused = joined(fill("<li>{}</li>", reason) for reason in facts["refused_prompts"].values())
    if refused:
        cards.append(fill("<h3>Not found</h3><ul>{}</ul>", refused))
    return _section("Objects", joined(cards) or Html("<p>No object was isolated yet.</p>"))


def _describe_prompt(prompt: dict[str, Any]) -> str:
    if prompt.get("kind") == "text":
        return f"prompt “{prompt.get('text', '')}”"
    return f"selected by {prompt.get('kind', 'hand')} in {prompt.get('photo', 'a photo')}"


def _held_out(facts: dict[str, Any], pictures: Pictures) -> Html:
    if not pictures.held_out:
        return Html()
    rows = joined(
        fill(
            "<figure>{photo}{render}{marked}<figcaption>{name}: the photo; the scene rendered from its camera; the "
            "same, pale where it shows what fewer than three training photos see</figcaption></figure>",
            photo=_image(pair.photo, "photo"),
            render=_image(pair.render, "render"),
            marked=_image(pair.marked, "render, pale where few photos look"),
            name=name,
        )
        for name, pair in pictures.held_out.items()
    )
    kept = facts["training"].get("held_out")
    text = (
        "These photos were never trained on: the second picture of each row is a new view for the scene."
        if kept
        else "There were too few photos for test photos; these were trained on."
    )
    return _section("Photo and scene", fill('<p>{}</p><div class="pairs">{}</div>', text, rows))


def _curve(facts: dict[str, Any]) -> Html:
    training = facts["training"]
    # Drawn from numbers only.
    svg = Html(error_curve(training.get("curve") or []))
    if not svg:
        return Html()
    table = [
        ("steps", _count((training.get("curve") or [{}])[-1].get("step"))),
        ("time per step", _number(training.get("step_ms"), "{:.0f} ms")),
        ("PSNR with the brightness fitted to each photo", _number(training.get("fitted_psnr"), "{:.1f} dB")),
        (
            "PSNR in what at least three training photos see",
            _number(training.get("well_seen_psnr"), "{:.1f} dB")
            + _number(training.get("well_seen_share"), " ({:.0%} of the pixels)"),
        ),
        ("bright pixels that are rendered dark", _number(training.get("dark_share"), "{:.1%}")),
        ("preset", str(training.get("preset") or "")),
    ]
    agreement = training.get("feature_agreement")
    if agreement:
        trained, untrained = (
            _number(agreement.get("trained"), "{:.2f}"),
            _number(agreement.get("untrained"), "{:.2f}"),
        )
        table.append(("segments of test photos reproduced by features (IoU)", f"{trained} (untrained {untrained})"))
    text = "Error on photos that were not trained on, over run time." if training.get("held_out") else ""
    content = fill('<p>{}</p><div class="plot">{}</div>{}', text, svg, _pairs(table))
    return _section("Error against run time", content)


def _stages(facts: dict[str, Any]) -> Html:
    rows = [
        (_stage_name(stage["stage"]), _duration(stage["wall_seconds"]), _duration(stage["cpu_seconds"]))
        for stage in facts["stages"]
    ]
    if not rows:
        return Html()
    wall, cpu = (_duration(sum(stage[key] for stage in facts["stages"])) for key in ("wall_seconds", "cpu_seconds"))
    return _section(
        "Time",
        fill(
            '<div class="wide"><table><thead><tr><th>stage</th><th>wall</th><th>CPU</th></tr></thead>'
            "<tbody>{rows}</tbody>"
            "<tfoot><tr><td>total</td><td>{wall}</td><td>{cpu}</td></tr></tfoot></table></div>",
            rows=joined(fill("<tr><td>{}</td><td>{}</td><td>{}</td></tr>", *row) for row in rows),
            wall=wall,
            cpu=cpu,
        ),
    )


def _photos(facts: dict[str, Any]) -> Html:
    photos, cameras = facts["photos"], facts["cameras"]
    table = [
        ("readable photos", _count(photos.get("n_photos"))),
        ("registered", _count(cameras.get("n_registered"))),
        ("reprojection error", _number(cameras.get("reprojection_error"), "{:.2f} px")),
        ("camera poses", "given" if cameras.get("poses_given") else "estimated" if cameras else ""),
        ("health of the cameras", (cameras.get("health") or {}).get("colour", "")),
        ("photos with segments", _count(facts["masks"].get("n_photos"))),
        ("time per segmented photo", _number(facts["masks"].get("seconds_per_photo"), "{:.1f} s")),
    ]
    rejected = [fill("<b>{}</b> {}", photo["name"], photo["reason"]) for photo in photos.get("rejected", ())]
    parts = (
        _pairs(table),
        _list("Not used", rejected, "Every photo was used."),
        _list("Not registered", cameras.get("unregistered", ()), "Every photo was registered."),
    )
    return _section("Photos", joined(parts))


def _plan(facts: dict[str, Any]) -> Html:
    """Return the plan, and the forecast with the actual cost."""
    plan, training = facts["plan"], facts["training"]
    if not plan:
        return Html()
    pairs = {"promising": "promising ones, about"}.get(plan["pairs"], plan["pairs"])
    table = [
        ("training pictures", f"{plan['width']} x {plan['height']}"),
        ("pairs matched", f"{pairs} {_count(plan['n_pairs'])}" if plan["n_pairs"] else pairs),
        ("photos with segments", _count(plan["n_mask_photos"])),
        ("maximum number of Gaussians", _count(plan["max_gaussians"])),
        ("degree of spherical harmonics", f"{training.get('sh_degree', plan['sh_degree'])} of {plan['sh_degree']}"),
        ("segmentation features", "yes" if plan["features"] else "no"),
        ("brightness correction per photo", "yes" if "exposure" in training else "no"),
        ("maximum number of steps", _count(plan["steps"])),
        ("trained on", _trained_on(plan, training)),
    ]
    return _section("Plan and forecast", joined((_pairs(table), _forecast(facts["forecast"]))))


def _trained_on(plan: dict[str, Any], training: dict[str, Any]) -> str:
    """Return the device of the training and why it was not the card; empty before it is trained."""
    name, planned = training.get("device"), plan.get("device") or {}
    if not name:
        return ""
    return device_words(name, planned.get("reason", "") if planned.get("name") == name else "")


def _forecast(rows: list[dict[str, Any]]) -> Html:
    if not rows:
        return Html()
    return fill(
        "<p>Forecast before the run, with the range in which 8 of 10 runs are expected, and the actual cost.</p>"
        '<div class="wide"><table><thead><tr><th>stage</th><th>time, forecast</th><th>actual</th>'
        "<th>memory, forecast</th><th>actual peak</th></tr></thead><tbody>{}</tbody></table></div>",
        joined(
            fill(
                "<tr><td>{}</td><td>{} ({} to {})</td><td>{}</td><td>{} ({} to {})</td><td>{}</td></tr>",
                _stage_name(row["stage"]),
                *(_duration(row[key]) for key in ("seconds", "low", "high")),
                _actual_time(row),
                *(_memory(row[key]) for key in ("memory", "memory_low", "memory_high", "actual_memory")),
            )
            for row in rows
        ),
    )


def _actual_time(row: dict[str, Any]) -> str:
    if row["actual_seconds"] is None:
        return "not done yet" if row["stage"] != "report" else "being written"
    in_parallel = (
        ""
        if row["beside_seconds"] is None
        else f" after {_duration(row['beside_seconds'])} while the cameras were estimated"
    )
    return _duration(row["actual_seconds"]) + in_parallel + (" (continued)" if row["continued"] else "")


def _memory(value: Any) -> str:
    return f"{value / 1e9:.2f} GB" if isinstance(value, int | float) else "unknown"


def _left_out(facts: dict[str, Any]) -> Html:
    items = [fill("<b>{}</b>: {}.{}", item["what"], item["why"], _saved(item)) for item in facts["left_out"]]
    return _section("What was left out", joined((_list("", items, "Nothing was left out."), _savings(facts))))


def _saved(item: dict[str, Any]) -> Html:
    return fill(' <span class="small">Saved: {}.</span>', item["saved"]) if item.get("saved") else Html()


def _savings(facts: dict[str, Any]) -> Html:
    saved = facts["measured_savings"]
    if not saved:
        return Html()
    masks = f" and {saved['mask_cpu_seconds']:.0f} CPU s of masks" if "mask_cpu_seconds" in saved else ""
    return fill(
        "<p>{}</p>",
        f"Measured against a run of the same preset with nothing left out: {saved['training_cpu_seconds']:.0f} CPU "
        f"s of training{masks} saved, at {saved['psnr_lost']:.2f} dB less on test photos.",
    )


def _guards(facts: dict[str, Any]) -> Html:
    fired = {name: n for name, n in (facts["training"].get("guards") or {}).items() if n}
    items = [
        fill("<b>{}</b> {}", _count(n), _GUARD_NAMES.get(name, name.replace("_", " "))) for name, n in fired.items()
    ]
    none = "None: all numbers stayed finite and within bounds."
    return _section("Numerical problems", joined((_list("", items, none), _limits(facts))))


def _limits(facts: dict[str, Any]) -> Html:
    """Return how many Gaussians the limits of the method clamped on average. That is normal and no problem."""
    training = facts["training"]
    limits, steps = training.get("limits") or {}, training.get("steps") or 0
    clamped = [
        f"{_count(round(limits[name] / steps))} {description}"
        for name, description in _LIMIT_NAMES.items()
        if steps and name in limits
    ]
    if not clamped:
        return Html()
    return fill(
        '<p class="small">{}</p>',
        "As in every run, limits of the method clamped some Gaussians. On average over the steps: "
        f"{', '.join(clamped)}; of {_count(training.get('n_gaussians'))} at the end.",
    )


def _record(facts: dict[str, Any]) -> Html:
    """Return when, with what and from what the scene was made."""
    record, written = facts["record"], facts["record"]["exported"]
    steps = {step["stage"]: step for step in record["steps"]}
    trained = steps.get("training") or {}
    seeds = [
        f"{_stage_name(stage).lower()} {step['seed']}" for stage, step in steps.items() if step["seed"] is not None
    ]
    table = [
        ("scene trained", trained.get("finished") or ""),
        ("trained with", _version(trained)),
        ("report written", written["finished"]),
        ("report written with", _version(written)),
        ("seeds", ", ".join(seeds)),
        ("unit of length", record["unit"]["text"]),
    ]
    versions = ", ".join(f"{name} {version}" for name, version in written["software"].items())
    scene = record["identifier"] or ""
    hashes = joined(fill("<li>{} <code>{}</code></li>", photo["name"], photo["sha256"]) for photo in record["captures"])
    parts = (
        _pairs(table),
        fill('<p class="small">{}. {}.</p>', versions, written["machine"]),
        fill('<p class="small">Gaussians: <code>{}</code></p>', scene) if scene else Html(),
        fill("<details><summary>SHA-256 of the photos</summary><ul>{}</ul></details>", hashes) if hashes else Html(),
    )
    return _section("Record", joined(parts))


def _version(run: dict[str, Any]) -> str:
    """Return version and commit of a run; empty where it is not known."""
    if not run.get("software"):
        return ""
    commit = f", commit {run['commit'][:12]}{' with changes' if run['changed'] else ''}" if run["commit"] else ""
    return f"Gaussian Heritage {run['software'].get('gaussian heritage', '')}{commit}"


def _stage_name(stage: str) -> str:
    return _STAGE_NAMES.get(stage, stage)


def _section(title: str, content: Html) -> Html:
    return fill("<section><h2>{}</h2>{}</section>", title, content)


def _list(title: str, items: Iterable[Html | str], otherwise: str) -> Html:
    lines = joined(fill("<li>{}</li>", item) for item in items)
    if not lines:
        return fill("<p>{}</p>", otherwise)
    return fill("{}<ul>{}</ul>", fill("<h3>{}</h3>", title) if title else "", lines)


def _pairs(rows: Iterable[tuple[str, str]]) -> Html:
    shown = joined(fill("<div><dt>{}</dt><dd>{}</dd></div>", name, value) for name, value in rows if value)
    return fill("<dl>{}</dl>", shown) if shown else Html()


def _image(pixels: NDArray[np.uint8], text: str) -> Html:
    from PIL import Image

    buffer = io.BytesIO()
    Image.fromarray(pixels).save(buffer, format="JPEG", quality=86)
    height, width = pixels.shape[:2]
    return fill(
        '<img loading="lazy" width="{}" height="{}" alt="{}" src="data:image/jpeg;base64,{}">',
        width,
        height,
        text,
        base64.b64encode(buffer.getvalue()).decode("ascii"),
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
