"""Numbers of 16 bits, padding and weight files of the classifier."""

from __future__ import annotations

from pathlib import Path

import pytest
import torch
from torch.nn import functional

from engine.core.errors import ModelFileError
from engine.objects.grounding.efficientnet import EfficientNetLite2, Stage, _pad_same
from tests.engine.install.models.weights import fetched


@pytest.fixture(scope="module")
def classifier() -> EfficientNetLite2:
    return EfficientNetLite2(fetched("efficientnet-lite2")[0])


def test_bfloat16_gives_nearly_the_same_classes(classifier: EfficientNetLite2) -> None:
    half = EfficientNetLite2(fetched("efficientnet-lite2")[0], bfloat16=True)
    pictures = torch.rand((2, 3, 260, 260), generator=torch.Generator().manual_seed(3)) * 255
    found, expected = (net.classes(net.pooled(pictures)) for net in (half, classifier))
    assert found.dtype == torch.float32
    assert 1e-4 < (found - expected).abs().max() < 0.5  # of logits up to 7; seen: 0.2
    assert (found.softmax(dim=1) - expected.softmax(dim=1)).abs().max() < 0.05  # seen: 0.02


@pytest.mark.parametrize(("size", "kernel", "stride"), [(260, 3, 2), (65, 5, 2), (33, 3, 1), (1, 5, 2), (64, 5, 2)])
def test_padding_gives_the_same_size_as_tensorflow(size: int, kernel: int, stride: int) -> None:
    x = torch.ones((1, 1, size, size + 1))
    out = functional.conv2d(_pad_same(x, kernel, stride), torch.ones((1, 1, kernel, kernel)), stride=stride)
    assert out.shape[2:] == (-(-size // stride), -(-(size + 1) // stride))


def test_another_file_gives_a_readable_error(tmp_path: Path) -> None:
    for content in (b"", b"nothing like weights"):
        (tmp_path / "net.pth").write_bytes(content)
        with pytest.raises(ModelFileError, match=r"net.pth is not EfficientNet-Lite2"):
            EfficientNetLite2(tmp_path / "net.pth")
    torch.save({"_conv_stem.weight": torch.zeros((32, 3, 3, 3))}, tmp_path / "net.pth")
    with pytest.raises(ModelFileError, match="not EfficientNet-Lite2"):
        EfficientNetLite2(tmp_path / "net.pth")
    with pytest.raises(ModelFileError, match="block 0 has an unexpected shape"):
        EfficientNetLite2(fetched("efficientnet-lite2")[0], stages=(Stage(1, 5, 1, 16),))
