"""The small JSON file that holds the results of an evaluation."""

from __future__ import annotations

from dataclasses import asdict, fields
from pathlib import Path

from ...core.files import finite_or_null, write_json
from ...core.settings import to_dict
from .results import Evaluation
from .summary import n_ranked_first, summarise

_VERSION = 1


def write_results(path: Path, evaluation: Evaluation) -> None:
    """Write an evaluation as JSON, with the figures of each method (`Summary`) for readers of the file.

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
