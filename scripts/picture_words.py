"""Make ``engine/objects/grounding/picture_features.npy``: what the pictures of ``picture_words.txt`` look like.

    apt-get download tuxpaint-stamps-default    # and unpack it: dpkg -x FILE FOLDER
    npm pack @lobehub/fluent-emoji-3d@1.1.0     # and unpack it: tar xf FILE
    python scripts/picture_words.py FOLDER/usr/share/tuxpaint/stamps package/assets

A new word is a row of ``engine/core/words/picture_words.txt``, which says of which packages the pictures are.
"""

from __future__ import annotations

import argparse
import sys
from pathlib import Path

import numpy as np

ROOT = Path(__file__).resolve().parents[1]
sys.path.insert(0, str(ROOT))

from engine.core.arrays import Float32, normalized  # noqa: E402
from engine.core.words.vocabulary_words import PICTURE_WORDS_FILE  # noqa: E402
from engine.masks import mask_box  # noqa: E402
from engine.objects.grounding.offline_vocabulary import OfflineVocabulary  # noqa: E402
from engine.objects.grounding.pictures import FEATURES_FILE  # noqa: E402

_SIDE, _MARGIN = 260, 100
"""Longest side of a picture, and the gray around it, in pixels: the margin of a crop shows no edge."""
_GRAY = 150


def described(file: Path, detector: OfflineVocabulary) -> Float32:
    """Return the square roots of the features of a picture of a thing on transparent ground, [2560]."""
    from PIL import Image

    with Image.open(file) as opened:
        picture = opened.convert("RGBA")
    picture.thumbnail((_SIDE, _SIDE))
    padding = ((_MARGIN, _MARGIN), (_MARGIN, _MARGIN), (0, 0))
    rgba = np.pad(np.asarray(picture), padding)
    mask = rgba[..., 3] > 127
    pixels = np.where(mask[..., None], rgba[..., :3], np.uint8(_GRAY))
    return detector.example_vectors(detector.describe_crops(pixels, [mask_box(mask)], [mask]))[0]


def write(pictures: dict[str, list[Float32]]) -> None:
    """Write the mean direction of the pictures of each word, [W, 2560], as whole numbers of at most 127.

    Parameters
    ----------
    pictures : dict of str to list of arrays of shape [2560]
        By word.
    """
    centre = np.mean([row for rows in pictures.values() for row in rows], axis=0)
    each = (normalized((np.stack(rows) - centre).reshape(len(rows), 2, -1)).mean(axis=0) for rows in pictures.values())
    found = normalized(np.stack(list(each))).reshape(len(pictures), -1)
    np.save(FEATURES_FILE, np.rint(found * (127 / np.abs(found).max(axis=1, keepdims=True))).astype(np.int8))


def main() -> None:
    """Write the file."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("stamps", type=Path, help="folder of the stamps of Tux Paint")
    parser.add_argument("emoji", type=Path, help="folder of the pictures of Fluent Emoji")
    options = parser.parse_args()
    detector, pictures = OfflineVocabulary(), {}
    for line in PICTURE_WORDS_FILE.read_text(encoding="utf-8").splitlines():
        if not line.startswith("#"):
            words, _, names = line.split("\t")
            files = (options.stamps / f"{name}.png" if "/" in name else options.emoji / f"{name}.webp"
                     for name in names.split())  # fmt: skip
            pictures[words] = [described(file, detector) for file in files]
    write(pictures)
    print(f"{len(pictures)} words, {sum(map(len, pictures.values()))} pictures")


if __name__ == "__main__":
    main()
