"""The encoder of MobileSAM in torch, which computes in bfloat16 where the processor does so faster.

TinyViT (Wu et al. 2022) as in MobileSAM (Zhang et al. 2023): two convolutions, two inverted bottlenecks, three stages
of attention in windows, and the neck of Segment Anything. What is computed for each pixel alone is computed in pieces
that fit the cache. In float32 this costs what ONNX Runtime costs, in bfloat16 half.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor
from torch.nn import functional

from ..install.models import one_thread

_STAGES = ((2, 7), (6, 14), (2, 7))
"""Blocks of each stage with attention, and the side of its windows."""
_HEAD_CHANNELS = 32
_PIECE_PIXELS = 1024
"""Pixels that are computed together."""
_NECK_EPS = 1e-6

Weights = Mapping[str, NDArray[np.float32]]
Layer = tuple[Tensor, Tensor]
"""Weight and bias; the weight is that of `conv2d` or, of a layer for each pixel, [out, in]."""


class TorchEncoder:
    """Encoder with the weights of an ONNX export of MobileSAM.

    Parameters
    ----------
    weights : mapping of str to float32 array
        From `models.read_onnx_weights`.
    bfloat16 : bool
        Compute in bfloat16 instead of float32.

    Raises
    ------
    KeyError
        When a weight is missing: the file has another structure.
    """

    def __init__(self, weights: Weights, *, bfloat16: bool) -> None:
        self._dtype = torch.bfloat16 if bfloat16 else torch.float32
        read = _Reader(weights, self._dtype)
        self._stem = [read.convolution(f"patch_embed/seq/seq.{index}") for index in (0, 2)]
        self._bottlenecks = [_Bottleneck(read, f"layers.0/blocks.{index}/", stride=1) for index in (0, 1)]
        # The last stage is as large as the one before.
        self._reductions = [
            _Bottleneck(read, f"layers.{index}/downsample/", stride=stride) for index, stride in enumerate((2, 2, 1))
        ]
        self._stages = [
            [_Block(read, f"layers.{stage}/blocks.{index}/", window) for index in range(count)]
            for stage, (count, window) in enumerate(_STAGES, start=1)
        ]
        self._neck = [read.tensor(f"/neck/neck.{index}/Conv:1") for index in (0, 2)]
        self._neck_norms = [
            (read.exact(f"/neck/neck.{index}/Mul:0").reshape(-1), read.exact(f"/neck/neck.{index}/Add_1:1").reshape(-1))
            for index in (1, 3)
        ]

    def encode(self, square: NDArray[np.float32]) -> NDArray[np.float32]:
        """Return the features, [1, 256, 64, 64], of the normalised, padded square, [1, 3, 1024, 1024]."""
        with one_thread(), torch.inference_mode():
            picture = torch.from_numpy(square).to(self._dtype).to(memory_format=torch.channels_last)
            picture = functional.gelu(functional.conv2d(picture, *self._stem[0], stride=2, padding=1))
            picture = functional.conv2d(picture, *self._stem[1], stride=2, padding=1)
            for bottleneck in self._bottlenecks:
                picture = functional.gelu(picture + bottleneck(picture))
            for reduction, blocks in zip(self._reductions, self._stages, strict=True):
                picture = reduction(picture)
                for block in blocks:
                    picture = block(picture)
            for weight, norm, padding in zip(self._neck, self._neck_norms, (0, 1), strict=True):
                rows = functional.conv2d(picture.to(self._dtype), weight, padding=padding).permute(0, 2, 3, 1).float()
                normed = functional.layer_norm(rows, rows.shape[-1:], *norm, eps=_NECK_EPS)
                picture = normed.permute(0, 3, 1, 2)
            return np.ascontiguousarray(picture.numpy())


class _Reader:
    """Weights by the nodes that use them."""

    def __init__(self, weights: Weights, dtype: torch.dtype) -> None:
        self._weights, self._dtype = weights, dtype

    def exact(self, name: str) -> Tensor:
        return torch.from_numpy(np.array(self._weights[name]))

    def tensor(self, name: str) -> Tensor:
        return self.exact(name).to(self._dtype)

    def convolution(self, name: str) -> Layer:
        weight = self.tensor(f"/{name}/c/Conv:1").to(memory_format=torch.channels_last)
        return weight, self.tensor(f"/{name}/c/Conv:2")

    def pixelwise_convolution(self, name: str) -> Layer:
        weight, bias = self.convolution(name)
        return weight[:, :, 0, 0].contiguous(), bias

    def linear(self, name: str) -> Layer:
        """The exporter transposes the weight and keeps the name of the bias."""
        return self.tensor(f"/{name}/MatMul:1").T.contiguous(), self.tensor(f"{name.replace('/', '.')}.bias")

    def norm(self, name: str) -> Layer:
        dotted = name.replace("/", ".")
        return self.tensor(f"{dotted}.weight"), self.tensor(f"{dotted}.bias")


class _Bottleneck:
    """More channels, a convolution of each channel alone, fewer channels."""

    def __init__(self, read: _Reader, prefix: str, *, stride: int) -> None:
        self._widen = read.pixelwise_convolution(prefix + "conv1")
        self._spread = read.convolution(prefix + "conv2")
        self._narrow = read.pixelwise_convolution(prefix + "conv3")
        self._stride = stride

    def __call__(self, picture: Tensor) -> Tensor:
        wide = _in_pieces(picture, lambda rows: functional.gelu(functional.linear(rows, *self._widen)))
        spread = functional.conv2d(wide, *self._spread, stride=self._stride, padding=1, groups=wide.shape[1])
        return _in_pieces(spread, lambda rows: functional.linear(functional.gelu(rows), *self._narrow))


class _Block:
    """Attention in windows, a convolution of each channel alone, and a perceptron."""

    def __init__(self, read: _Reader, prefix: str, window: int) -> None:
        self._window = window
        self._attention_norm = read.norm(prefix + "attn/norm")
        self._queries_keys_values, self._out = read.linear(prefix + "attn/qkv"), read.linear(prefix + "attn/proj")
        # As a mask of [1, heads, n, n] it does not keep torch from its fast attention.
        self._bias = read.tensor(f"/{prefix}attn/Add:1")[None]
        self._spread = read.convolution(prefix + "local_conv")
        self._norm = read.norm(prefix + "mlp/norm")
        self._hidden, self._output = read.linear(prefix + "mlp/fc1"), read.linear(prefix + "mlp/fc2")

    def __call__(self, picture: Tensor) -> Tensor:
        picture = picture + self._attended(picture)
        picture = functional.conv2d(picture, *self._spread, padding=1, groups=picture.shape[1])
        return picture + _in_pieces(picture, self._perceptron)

    def _perceptron(self, rows: Tensor) -> Tensor:
        normed = functional.layer_norm(rows, rows.shape[1:], *self._norm)
        return functional.linear(functional.gelu(functional.linear(normed, *self._hidden)), *self._output)

    def _attended(self, picture: Tensor) -> Tensor:
        """Return what each pixel sees in its window. Windows that leave the picture contain zeros there."""
        _, channels, height, width = picture.shape
        side = self._window
        down, across = -(-height // side), -(-width // side)
        padded = functional.pad(picture.permute(0, 2, 3, 1), (0, 0, 0, across * side - width, 0, down * side - height))
        windows = padded.reshape(down, side, across, side, channels).transpose(1, 2).reshape(-1, side * side, channels)
        windows = functional.layer_norm(windows, (channels,), *self._attention_norm)
        heads = functional.linear(windows, *self._queries_keys_values)
        heads = heads.reshape(*windows.shape[:2], channels // _HEAD_CHANNELS, 3 * _HEAD_CHANNELS).transpose(1, 2)
        queries, keys, values = heads.chunk(3, dim=-1)
        seen = functional.scaled_dot_product_attention(queries, keys, values, attn_mask=self._bias)
        seen = functional.linear(seen.transpose(1, 2).reshape(windows.shape), *self._out)
        seen = seen.reshape(down, across, side, side, channels).transpose(1, 2)
        return seen.reshape(1, down * side, across * side, channels)[:, :height, :width].permute(0, 3, 1, 2)


def _in_pieces(picture: Tensor, layer: Callable[[Tensor], Tensor]) -> Tensor:
    """Return a picture [1, c, h, w] to whose pixels, [n, c], `layer` was applied."""
    _, channels, height, width = picture.shape
    rows = picture.permute(0, 2, 3, 1).reshape(-1, channels)
    done = torch.cat([layer(piece) for piece in rows.split(_PIECE_PIXELS)])
    return done.reshape(1, height, width, -1).permute(0, 3, 1, 2)
