"""The option ``--sam`` and the models it selects, shared by several commands; no command of its own."""

from __future__ import annotations

import argparse
from typing import Any

from ...masks.settings import SAM_MODELS


def add_sam_argument(parser: argparse.ArgumentParser) -> None:
    """Add ``--sam``."""
    parser.add_argument(
        "--sam", choices=SAM_MODELS, default=SAM_MODELS[0], help="Segment Anything model (default: %(default)s)"
    )


def model_factories(options: argparse.Namespace) -> dict[str, Any]:
    """Return `detector_factory` and `sam_factory` for the options. Each loads its model when it is called."""
    from ...masks import load_sam
    from ...objects.grounding import load_default_detector

    return {"detector_factory": load_default_detector, "sam_factory": lambda: load_sam(options.sam)}
