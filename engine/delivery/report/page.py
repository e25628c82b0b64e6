"""The report as one HTML page that loads no other file."""

from __future__ import annotations

import base64
import io
from collections.abc import Iterable
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ...core.language import Language, Translate
from ...core.stage_names import STAGE_NAMES
from .markup import Html, fill, joined
from .style import STYLE
from .views import PhotoPair

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
_COLOUR_NAMES = {"green": "good (green)", "yellow": "doubtful (yellow)", "red": "bad (red)"}
_PAIR_NAMES = {"none": "none", "all": "all", "promising": "promising ones, about"}

_BAD = ("yellow", "red")
"""Colours of the cameras' health whose sentence stands above everything else."""
_LOW_AGREEMENT = 0.8
"""Agreement with its mask below which an object is marked: museum_room has 0.74 to 0.98."""


@dataclass(frozen=True)
class Pictures:
    """Pictures of the page.

    Attributes
    ----------
    held_out : dict of str to PhotoPair
        Pairs by photo name.
    objects : dict of str to list of uint8 arrays [H, W, 3]
        Pictures by object id.
    curves : dict of str to str
        What `error_curve` draws, by code of the language.
    """

    held_out: dict[str, PhotoPair] = field(default_factory=dict)
    objects: dict[str, list[NDArray[np.uint8]]] = field(default_factory=dict)
    curves: dict[str, str] = field(default_factory=dict)


def page(facts: dict[str, Any], pictures: Pictures, language: Language) -> str:
    """Return the page as HTML text.

    Parameters
    ----------
    facts : dict
        As returned by `collect_facts`.
    language : Language
        Of the page. Sentences that the stages stored stay English.

    Returns
    -------
    str
    """
    t = language.translated
    parts = (
        _head(facts, t),
        _objects(facts, pictures, t),
        _held_out(facts, pictures, t),
        _curve(facts, pictures.curves.get(language.code, ""), t),
        _stages(facts, t),
        _plan(facts, t),
        _photos(facts, t),
        _left_out(facts, language),
        _guards(facts, t),
        _record(facts, t),
    )
    return fill(
        '<!doctype html>\n<html lang="{language}"><head><meta charset="utf-8">'
        '<meta name="viewport" content="width=device-width, initial-scale=1"><title>{title}</title>'
        "<style>{style}</style></head><body><main>{parts}</main></body></html>\n",
        language=language.code,
        title=facts["title"],
        style=Html(STYLE),
        parts=joined(parts),
    )


def _head(facts: dict[str, Any], t: Translate) -> Html:
    training, cameras = facts["training"], facts["cameras"]
    last = (training.get("curve") or [{}])[-1]
    tiles = [
        (t("photos used"), _count(cameras.get("n_registered"))),
        (t("Gaussians"), _count(training.get("n_gaussians") or last.get("n_gaussians"))),
        (t("object" if len(facts["objects"]) == 1 else "objects"), _count(len(facts["objects"]))),
        (t("PSNR on test photos" if training.get("held_out") else "PSNR"), _number(last.get("psnr"), "{:.1f} dB")),
        (t("SSIM"), _number(last.get("ssim"), "{:.3f}")),
        (t("total run time"), _duration(sum(stage["wall_seconds"] for stage in facts["stages"]))),
    ]
    health = cameras.get("health") or {}
    waiting = [_stage_name(stage, t) for stage in facts["not_done"] if stage not in ("objects", "masks")]
    return fill(
        '<header><p>{what}</p><h1>{title}</h1></header>{health}<div class="tiles">{tiles}</div>{note}',
        what=t("Gaussian Heritage report"),
        title=facts["title"],
        tiles=joined(fill("<div><b>{}</b><span>{}</span></div>", value, name) for name, value in tiles if value),
        health=fill('<p class="low">{}</p>', health["sentence"]) if health.get("colour") in _BAD else Html(),
        note=fill('<p class="note">{}</p>', t("Not done yet: {}.", "; ".join(waiting))) if waiting else "",
    )


def _objects(facts: dict[str, Any], pictures: Pictures, t: Translate) -> Html:
    low = t(
        "Low agreement with its mask: a part may be missing, or something else may belong to it. Look at it, and "
        "correct it with clicks."
    )
    cards = []
    for record in facts["objects"]:
        sides = pictures.objects.get(record["id"], [])
        photos = len({one["photo"] for one in record["evidence"]})
        details = (
            _describe_prompt(record["prompt"], t),
            t("{} Gaussians", _count(record["n_gaussians"])),
            t("confidence {}", f"{record['score']:.2f}"),
            t("agreement with its mask {}", f"{record['fit']:.2f}"),
            t(
                "recognised in {} photo, whose mask chose its Gaussians"
                if photos == 1
                else "recognised in {} photos, whose masks chose its Gaussians",
                photos,
            ),
            f"{record['seconds']:.0f} s",
        )
        cards.append(
            fill(
                '<article><h3>{name}</h3><div class="sides">{images}</div><p>{details}</p>{low}</article>',
                name=record["name"],
                images=joined(_image(side, t("{}, side {}", record["name"], i)) for i, side in enumerate(sides, 1)),
                details="; ".join(details),
                low=fill('<p class="low">{}</p>', low) if record["fit"] < _LOW_AGREEMENT else Html(),
            )
        )
    refused = joined(fill("<li>{}</li>", reason) for reason in facts["refused_prompts"].values())
    if refused:
        cards.append(fill("<h3>{}</h3><ul>{}</ul>", t("Not found"), refused))
    return _section(t("Objects"), joined(cards) or fill("<p>{}</p>", t("No object was isolated yet.")))


def _describe_prompt(prompt: dict[str, Any], t: Translate) -> str:
    if prompt.get("kind") == "text":
        return t("prompt “{}”", prompt.get("text", ""))
    return t("selected by {} in {}", prompt.get("kind", "hand"), prompt.get("photo") or t("a photo"))


def _held_out(facts: dict[str, Any], pictures: Pictures, t: Translate) -> Html:
    if not pictures.held_out:
        return Html()
    rows = joined(
        fill(
            "<figure>{photo}{render}{marked}<figcaption>{name}: {caption}</figcaption></figure>",
            photo=_image(pair.photo, t("photo")),
            render=_image(pair.render, t("render")),
            marked=_image(pair.marked, t("render, pale where few photos look")),
            name=name,
            caption=t(
                "the photo; the scene rendered from its camera; the same, pale where it shows what fewer than three "
                "training photos see"
            ),
        )
        for name, pair in pictures.held_out.items()
    )
    kept = facts["training"].get("held_out")
    text = t(
        "These photos were never trained on: the second picture of each row is a new view for the scene."
        if kept
        else "There were too few photos for test photos; these were trained on."
    )
    return _section(t("Photo and scene"), fill('<p>{}</p><div class="pairs">{}</div>', text, rows))


def _curve(facts: dict[str, Any], curve: str, t: Translate) -> Html:
    training = facts["training"]
    # Drawn from numbers only.
    svg = Html(curve)
    if not svg:
        return Html()
    table = [
        (t("steps"), _count((training.get("curve") or [{}])[-1].get("step"))),
        (t("time per step"), _number(training.get("step_ms"), "{:.0f} ms")),
        (t("PSNR with the brightness fitted to each photo"), _number(training.get("fitted_psnr"), "{:.1f} dB")),
        (
            t("PSNR in what at least three training photos see"),
            _number(training.get("well_seen_psnr"), "{:.1f} dB")
            + _number(training.get("well_seen_share"), t(" ({:.0%} of the pixels)")),
        ),
        (t("bright pixels that are rendered dark"), _number(training.get("dark_share"), "{:.1%}")),
        (t("preset"), t(str(training.get("preset") or "").capitalize())),
    ]
    agreement = training.get("feature_agreement")
    if agreement:
        trained, untrained = (
            _number(agreement.get("trained"), "{:.2f}"),
            _number(agreement.get("untrained"), "{:.2f}"),
        )
        name = t("segments of test photos reproduced by features (IoU)")
        table.append((name, t("{} (untrained {})", trained, untrained)))
    text = t("Error on photos that were not trained on, over run time.") if training.get("held_out") else ""
    content = fill('<p>{}</p><div class="plot">{}</div>{}', text, svg, _pairs(table))
    return _section(t("Error against run time"), content)


def _stages(facts: dict[str, Any], t: Translate) -> Html:
    rows = [
        (_stage_name(stage["stage"], t), _duration(stage["wall_seconds"]), _duration(stage["cpu_seconds"]))
        for stage in facts["stages"]
    ]
    if not rows:
        return Html()
    wall, cpu = (_duration(sum(stage[key] for stage in facts["stages"])) for key in ("wall_seconds", "cpu_seconds"))
    return _section(
        t("Time"),
        fill(
            '<div class="wide"><table><thead>{head}</thead><tbody>{rows}</tbody>'
            "<tfoot><tr><td>{total}</td><td>{wall}</td><td>{cpu}</td></tr></tfoot></table></div>",
            head=_table_head(t("stage"), t("wall time"), t("CPU time")),
            rows=joined(fill("<tr><td>{}</td><td>{}</td><td>{}</td></tr>", *row) for row in rows),
            total=t("total"),
            wall=wall,
            cpu=cpu,
        ),
    )


def _photos(facts: dict[str, Any], t: Translate) -> Html:
    photos, cameras = facts["photos"], facts["cameras"]
    table = [
        (t("readable photos"), _count(photos.get("n_photos"))),
        (t("registered"), _count(cameras.get("n_registered"))),
        (t("reprojection error"), _number(cameras.get("reprojection_error"), "{:.2f} px")),
        (t("camera poses"), t("given" if cameras.get("poses_given") else "estimated") if cameras else ""),
        (t("health of the cameras"), t(_COLOUR_NAMES.get((cameras.get("health") or {}).get("colour", ""), ""))),
        (t("photos with segments"), _count(facts["masks"].get("n_photos"))),
        (t("time per segmented photo"), _number(facts["masks"].get("seconds_per_photo"), "{:.1f} s")),
    ]
    rejected = [fill("<b>{}</b> {}", photo["name"], photo["reason"]) for photo in photos.get("rejected", ())]
    parts = (
        _pairs(table),
        _list(t("Not used"), rejected, t("Every photo was used.")),
        _list(t("Not registered"), cameras.get("unregistered", ()), t("Every photo was registered.")),
    )
    return _section(t("Photos"), joined(parts))


def _plan(facts: dict[str, Any], t: Translate) -> Html:
    """Return the plan, and the forecast with the actual cost."""
    plan, training = facts["plan"], facts["training"]
    if not plan:
        return Html()
    pairs = _PAIR_NAMES.get(plan["pairs"], plan["pairs"])
    degree = t("{} of {}", training.get("sh_degree", plan["sh_degree"]), plan["sh_degree"])
    table = [
        (t("training pictures"), f"{plan['width']} x {plan['height']}"),
        (t("pairs matched"), f"{t(pairs)} {_count(plan['n_pairs'])}" if plan["n_pairs"] else t(pairs)),
        (t("photos with segments"), _count(plan["n_mask_photos"])),
        (t("maximum number of Gaussians"), _count(plan["max_gaussians"])),
        (t("degree of spherical harmonics"), degree),
        (t("segmentation features"), t("yes" if plan["features"] else "no")),
        (t("brightness correction per photo"), t("yes" if "exposure" in training else "no")),
        (t("maximum number of steps"), _count(plan["steps"])),
        (t("trained on"), _trained_on(plan, training, t)),
    ]
    return _section(t("Plan and forecast"), joined((_pairs(table), _forecast(facts["forecast"], t))))


def _trained_on(plan: dict[str, Any], training: dict[str, Any], t: Translate) -> str:
    """Return the device of the training and why it was not the card; empty before it is trained."""
    name, planned = training.get("device"), plan.get("device") or {}
    if not name:
        return ""
    shown, reason = t("the processor") if name == "cpu" else str(name), planned.get("reason")
    return t("{}, because {}", shown, t(reason)) if reason and planned.get("name") == name else shown


def _forecast(rows: list[dict[str, Any]], t: Translate) -> Html:
    if not rows:
        return Html()
    return fill(
        '<p>{}</p><div class="wide"><table><thead>{}</thead><tbody>{}</tbody></table></div>',
        t("Forecast before the run, with the range in which 8 of 10 runs are expected, and the actual cost."),
        _table_head(t("stage"), t("time, forecast"), t("actual"), t("memory, forecast"), t("actual peak")),
        joined(
            fill(
                "<tr><td>{}</td><td>{}</td><td>{}</td><td>{}</td><td>{}</td></tr>",
                _stage_name(row["stage"], t),
                t("{} ({} to {})", *(_duration(row[key]) for key in ("seconds", "low", "high"))),
                _actual_time(row, t),
                t("{} ({} to {})", *(_memory(row[key], t) for key in ("memory", "memory_low", "memory_high"))),
                _memory(row["actual_memory"], t),
            )
            for row in rows
        ),
    )


def _actual_time(row: dict[str, Any], t: Translate) -> str:
    if row["actual_seconds"] is None:
        return t("not done yet" if row["stage"] != "report" else "being written")
    words = [_duration(row["actual_seconds"])]
    if row["beside_seconds"] is not None:
        words.append(t("after {} while the cameras were estimated", _duration(row["beside_seconds"])))
    if row["continued"]:
        words.append(t("(continued)"))
    return " ".join(words)


def _memory(value: Any, t: Translate) -> str:
    return f"{value / 1e9:.2f} GB" if isinstance(value, int | float) else t("unknown")


def _left_out(facts: dict[str, Any], language: Language) -> Html:
    t, said = language.translated, language.said
    items = [
        fill("<b>{}</b>: {}.{}", said(item["what"]), said(item["why"]), _saved(item, language))
        for item in facts["left_out"]
    ]
    content = (_list("", items, t("Nothing was left out.")), _savings(facts, t))
    return _section(t("What was left out"), joined(content))


def _saved(item: dict[str, Any], language: Language) -> Html:
    t, said = language.translated, language.said
    return fill(' <span class="small">{}</span>', t("Saved: {}.", said(item["saved"]))) if item.get("saved") else Html()


def _savings(facts: dict[str, Any], t: Translate) -> Html:
    saved = facts["measured_savings"]
    if not saved:
        return Html()
    parts = [t("{} CPU s of training", f"{saved['training_cpu_seconds']:.0f}")]
    if "mask_cpu_seconds" in saved:
        parts.append(t("{} CPU s of masks", f"{saved['mask_cpu_seconds']:.0f}"))
    sentence = t(
        "Measured against a run of the same preset with nothing left out: {} saved, at {} dB less on test photos.",
        ", ".join(parts),
        f"{saved['psnr_lost']:.2f}",
    )
    return fill("<p>{}</p>", sentence)


def _guards(facts: dict[str, Any], t: Translate) -> Html:
    fired = {name: n for name, n in (facts["training"].get("guards") or {}).items() if n}
    items = [
        fill("<b>{}</b> {}", _count(n), t(_GUARD_NAMES.get(name, name.replace("_", " ")))) for name, n in fired.items()
    ]
    none = t("None: all numbers stayed finite and within bounds.")
    return _section(t("Numerical problems"), joined((_list("", items, none), _limits(facts, t))))


def _limits(facts: dict[str, Any], t: Translate) -> Html:
    """Return how many Gaussians the limits of the method clamped on average. That is normal and no problem."""
    training = facts["training"]
    limits, steps = training.get("limits") or {}, training.get("steps") or 0
    clamped = [
        f"{_count(round(limits[name] / steps))} {t(description)}"
        for name, description in _LIMIT_NAMES.items()
        if steps and name in limits
    ]
    if not clamped:
        return Html()
    sentence = t(
        "As in every run, limits of the method clamped some Gaussians. On average over the steps: {}; "
        "of {} at the end.",
        ", ".join(clamped),
        _count(training.get("n_gaussians")),
    )
    return fill('<p class="small">{}</p>', sentence)


def _record(facts: dict[str, Any], t: Translate) -> Html:
    """Return when, with what and from what the scene was made."""
    record, written = facts["record"], facts["record"]["exported"]
    steps = {step["stage"]: step for step in record["steps"]}
    trained = steps.get("training") or {}
    seeds = [f"{_stage_name(stage, t)} {step['seed']}" for stage, step in steps.items() if step["seed"] is not None]
    table = [
        (t("scene trained"), trained.get("finished") or ""),
        (t("trained with"), _version(trained, t)),
        (t("report written"), written["finished"]),
        (t("report written with"), _version(written, t)),
        (t("seeds"), "; ".join(seeds)),
        (t("unit of length"), t(record["unit"]["text"])),
    ]
    versions = ", ".join(f"{name} {version}" for name, version in written["software"].items())
    scene = record["identifier"] or ""
    hashes = joined(fill("<li>{} <code>{}</code></li>", photo["name"], photo["sha256"]) for photo in record["captures"])
    parts = (
        _pairs(table),
        fill('<p class="small">{}. {}.</p>', versions, written["machine"]),
        fill('<p class="small">{}: <code>{}</code></p>', t("Gaussians"), scene) if scene else Html(),
        fill("<details><summary>{}</summary><ul>{}</ul></details>", t("SHA-256 of the photos"), hashes)
        if hashes
        else Html(),
    )
    return _section(t("Record"), joined(parts))


def _version(run: dict[str, Any], t: Translate) -> str:
    """Return version and commit of a run; empty where it is not known."""
    if not run.get("software"):
        return ""
    words = f"Gaussian Heritage {run['software'].get('gaussian heritage', '')}"
    if run["commit"]:
        words += ", " + t("commit {} with changes" if run["changed"] else "commit {}", run["commit"][:12])
    return words


def _stage_name(stage: str, t: Translate) -> str:
    return t(STAGE_NAMES.get(stage, stage))


def _table_head(*names: str) -> Html:
    return fill("<tr>{}</tr>", joined(fill("<th>{}</th>", name) for name in names))


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
