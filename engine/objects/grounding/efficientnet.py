"""EfficientNet-Lite2 in torch: features, and logits of 1,000 classes, per picture or per cell of the last feature map.

References
----------
Tan and Le, "EfficientNet: Rethinking Model Scaling for Convolutional Neural Networks", 2019, table 1; the Lite variants
omit squeeze-and-excitation, replace swish with ReLU6 and keep stem and head at their base width.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import torch
from torch import Tensor
from torch.nn import functional

from ...core.errors import ModelFileError

INPUT_SIDE = 260
N_FEATURES = 1280
# The Lite models were trained on (RGB - 127) / 128.
_MEAN, _DEVIATION = 127.0, 128.0
_BATCH_NORM_EPSILON = 1e-3


@dataclass(frozen=True)
class Stage:
    """A row of the paper's table 1, with its blocks scaled by the network's depth and its channels by the width."""

    blocks: int
    kernel: int
    stride: int
    channels: int


_STAGES = (
    Stage(1, 3, 1, 16),
    Stage(3, 3, 2, 24),
    Stage(3, 5, 2, 48),
    Stage(4, 3, 2, 88),
    Stage(4, 5, 1, 120),
    Stage(5, 5, 2, 208),
    Stage(1, 3, 1, 352),
)  # Tan and Le 2019, scaled by width 1.1 and depth 1.2


@dataclass(frozen=True)
class _Convolution:
    """A convolution that includes its batch normalisation."""

    weight: Tensor
    bias: Tensor
    stride: int
    groups: int

    def __call__(self, x: Tensor) -> Tensor:
        kernel = self.weight.shape[-1]
        if self.stride == 1:  # equal on all sides: no padded copy is needed
            return functional.conv2d(x, self.weight, self.bias, padding=kernel // 2, groups=self.groups)
        padded = _pad_same(x, kernel, self.stride)
        return functional.conv2d(padded, self.weight, self.bias, self.stride, groups=self.groups)


class EfficientNetLite2:
    """The image classifier.

    Parameters
    ----------
    path : Path
        ``efficientnet-lite2-9656183e.pth`` from `models.locate`.
    stages : tuple of Stage
        The rows of the network in the file, for another of the Lite networks than Lite2.
    bfloat16 : bool
        Compute the layers before the classes in bfloat16, which takes half of the time on processors that multiply it.

    Raises
    ------
    ModelFileError
        When the file is damaged or contains another network.
    """

    def __init__(self, path: Path, *, stages: tuple[Stage, ...] = _STAGES, bfloat16: bool = False) -> None:
        self._dtype = torch.bfloat16 if bfloat16 else torch.float32
        try:
            state: dict[str, Tensor] = torch.load(path, map_location="cpu", weights_only=True)
            self._stem = _load_convolution(state, self._dtype, "_conv_stem", "_bn0", stride=2)
            self._blocks = _load_blocks(state, stages, self._dtype)
            self._head = _load_convolution(state, self._dtype, "_conv_head", "_bn1")
            self._class_weight, self._class_bias = state["_fc.weight"], state["_fc.bias"]
        except Exception as error:  # torch.load raises several unrelated types on a damaged file
            raise ModelFileError(
                f"The model file {path} is not EfficientNet-Lite2 ({error}). Run: python -m engine models fetch"
            ) from error

    @torch.inference_mode()
    def pooled(self, pictures: Tensor) -> Tensor:
        """Return the mean of the last feature map, shape [B, 1280], float32.

        Parameters
        ----------
        pictures : Tensor of shape [B, 3, H, W], float32
            sRGB, 0 to 255.
        """
        # The colours of a pixel side by side, in all layers: convolutions are more than twice as fast.
        pictures = pictures.contiguous(memory_format=torch.channels_last)
        x = functional.relu6(self._stem(((pictures - _MEAN) / _DEVIATION).to(self._dtype)), inplace=True)
        for expand, depthwise, project, residual in self._blocks:
            y = x if expand is None else functional.relu6(expand(x), inplace=True)
            y = project(functional.relu6(depthwise(y), inplace=True))
            x = y.add_(x) if residual else y
        return functional.relu6(self._head(x), inplace=True).float().mean(dim=(2, 3))

    @torch.inference_mode()
    def classes(self, pooled: Tensor) -> Tensor:
        """Return class logits, shape [B, 1000], of what `pooled` returned."""
        return functional.linear(pooled, self._class_weight, self._class_bias)


def _load_convolution(
    state: dict[str, Tensor], dtype: torch.dtype, convolution: str, norm: str, *, stride: int = 1
) -> _Convolution:
    """Return the convolution and the batch normalisation of these names as one convolution."""
    weight = state[f"{convolution}.weight"]
    factor = state[f"{norm}.weight"] / torch.sqrt(state[f"{norm}.running_var"] + _BATCH_NORM_EPSILON)
    groups = weight.shape[0] if weight.shape[1] == 1 and weight.shape[0] > 1 else 1
    bias = state[f"{norm}.bias"] - state[f"{norm}.running_mean"] * factor
    weight = (weight * factor[:, None, None, None]).to(dtype).contiguous(memory_format=torch.channels_last)
    return _Convolution(weight, bias.to(dtype), stride, groups)


_Block = tuple[_Convolution | None, _Convolution, _Convolution, bool]
"""Expansion (None if omitted), depthwise convolution, projection, and whether the block has a residual connection."""


def _load_blocks(state: dict[str, Tensor], stages: tuple[Stage, ...], dtype: torch.dtype) -> list[_Block]:
    blocks: list[_Block] = []
    channels = 32
    for stage in stages:
        for position in range(stage.blocks):
            name = f"_blocks.{len(blocks)}"
            stride = stage.stride if position == 0 else 1
            expand = None
            if f"{name}._expand_conv.weight" in state:
                expand = _load_convolution(state, dtype, f"{name}._expand_conv", f"{name}._bn0")
            depthwise = _load_convolution(state, dtype, f"{name}._depthwise_conv", f"{name}._bn1", stride=stride)
            project = _load_convolution(state, dtype, f"{name}._project_conv", f"{name}._bn2")
            if depthwise.weight.shape[-1] != stage.kernel or project.weight.shape[0] != stage.channels:
                raise ValueError(f"block {len(blocks)} has an unexpected shape")
            blocks.append((expand, depthwise, project, stride == 1 and channels == stage.channels))
            channels = stage.channels
    return blocks


def _pad_same(x: Tensor, kernel: int, stride: int) -> Tensor:
    """Pad like TensorFlow's SAME, used in training: if the padding is odd, the extra pixel is added right and below."""
    height, width = x.shape[-2:]
    down = max((-(-height // stride) - 1) * stride + kernel - height, 0)
    across = max((-(-width // stride) - 1) * stride + kernel - width, 0)
    if down == 0 and across == 0:
        return x
    return functional.pad(x, (across // 2, across - across // 2, down // 2, down - down // 2))
