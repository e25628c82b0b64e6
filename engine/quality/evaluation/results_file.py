"""The small JSON file that holds the results of an evaluation."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict, fields
from pathlib import Path
from typing import Any, TypeVar, cast, get_args

from ...core.errors import FormatError
from ...core.files import finite_or_null, read_json, write_json
from ...core.settings import to_dict
from .ground_truth import LAYOUTS, Layout
from .results import Evaluation, Result, ResultKind, Row, Search, Word
from .settings import EvaluationSettings
from .summary import n_ranked_first, summarise

__all__ = ["read_results", "write_results"]

_VERSION = 1
_ADVICE = "Run `python -m engine evaluate` again."

_Record = TypeVar("_Record", Row, Word, Result)
_TYPES = {"str": str, "bool": bool, "int": int, "float": (float, None), "ResultKind": str}
"""Schema of a field by its annotation. JSON has no NaN; null stands for it."""


def _schema_of(record: type[Row] | type[Word] | type[Result]) -> dict[str, Any]:
    return {field.name: _TYPES[str(field.type)] for field in fields(record)}


def _record_of(record: type[_Record], values: Mapping[str, Any]) -> _Record:
    numbers = {field.name for field in fields(record) if field.type == "float"}
    known = {field.name: values[field.name] for field in fields(record)}
    return record(
        **{name: _number(value) if name in numbers else value for name, value in known.items()}  # type: ignore[arg-type]
    )


def _number(value: float | None) -> float:
    return float("nan") if value is None else float(value)


_SETTINGS = {
    "presets": [str],
    "prompt_kind": str,
    "views": str,
    "ablations": bool,
    "view_counts": [int],
    "objects": [str],
}
_SCHEMA = {
    "version": int,
    "rows": [_schema_of(Row)],
    "words": [_schema_of(Word)],
    "searches": [
        {"method": str, "results": [_schema_of(Result)], "seconds": (float, None), "cpu_seconds": (float, None)}
    ],
    "ceiling": ({str: str}, None),
    "settings": _SETTINGS,
    "scene": str,
    "layout": str,
    "photos": [str],
    "looked_at": [str],
    "n_trained_on": int,
    "unplaced": [str],
    "left_out": [str],
    "n_gaussians": int,
    "stages": [{"stage": str, "seconds": float, "cpu_seconds": float}],
}


def write_results(path: Path, evaluation: Evaluation) -> None:
    """Write an evaluation as JSON, with the figures of each method (`Summary`) for readers of the file.

    `read_results` ignores those figures, because they follow from the rows.

    Raises
    ------
    DiskError
        When the file cannot be written.
    """
    values = {
        "version": _VERSION,
        "summary": [asdict(summary) for summary in summarise(evaluation)],
        "words_ranked_first": n_ranked_first(evaluation),
        **{field.name: getattr(evaluation, field.name) for field in fields(evaluation)},
        "rows": [asdict(row) for row in evaluation.rows],
        "words": [asdict(word) for word in evaluation.words],
        "searches": [asdict(search) for search in evaluation.searches],
        "ceiling": None if evaluation.ceiling is None else dict(evaluation.ceiling),
        "settings": to_dict(evaluation.settings),
        "stages": [
            {"stage": stage, "seconds": seconds, "cpu_seconds": cpu_seconds}
            for stage, seconds, cpu_seconds in evaluation.stages
        ],
    }
    write_json(path, finite_or_null(values))


def read_results(path: Path) -> Evaluation:
    """Return the evaluation that `write_results` wrote.

    Raises
    ------
    FormatError
        When the file cannot be read, is no such file or was written by another version.
    SettingsError
        When it has settings that this version does not know.
    """
    data = read_json(path, _SCHEMA, advice=_ADVICE)
    kinds = {one["kind"] for search in data["searches"] for one in search["results"]}
    if data["version"] != _VERSION or data["layout"] not in LAYOUTS or not kinds <= set(get_args(ResultKind)):
        raise FormatError(f"{path} was written by another version of Gaussian Heritage. {_ADVICE}")
    settings = {name: tuple(value) if isinstance(value, list) else value for name, value in data["settings"].items()}
    return Evaluation(
        rows=tuple(_record_of(Row, row) for row in data["rows"]),
        words=tuple(_record_of(Word, word) for word in data["words"]),
        searches=tuple(
            Search(
                search["method"],
                tuple(_record_of(Result, one) for one in search["results"]),
                _number(search["seconds"]),
                _number(search["cpu_seconds"]),
            )
            for search in data["searches"]
        ),
        ceiling=data["ceiling"],
        settings=EvaluationSettings(**{name: settings[name] for name in _SETTINGS}),  # type: ignore[arg-type]
        scene=data["scene"],
        layout=cast(Layout, data["layout"]),
        photos=tuple(data["photos"]),
        looked_at=tuple(data["looked_at"]),
        n_trained_on=data["n_trained_on"],
        unplaced=tuple(data["unplaced"]),
        left_out=tuple(data["left_out"]),
        n_gaussians=data["n_gaussians"],
        stages=tuple((one["stage"], float(one["seconds"]), float(one["cpu_seconds"])) for one in data["stages"]),
    )
