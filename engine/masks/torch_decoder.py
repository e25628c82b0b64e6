"""The mask decoder of Segment Anything in torch, for exports that return one mask per prompt.

A click costs less than half of the CPU time that ONNX Runtime needs for the same file; the logits differ by rounding:

- What does not depend on the prompt is computed once per photo: the first layer's keys, values and queries.
- There are only 7 tokens, so products are taken in the cheaper order: (tokens W^T) picture^T in place of
  tokens (picture W)^T, and (attention picture) W in place of attention (picture W).
- Only the returned one of four masks is enlarged, and in pieces that fit the cache.

In bfloat16 a click costs half of that again, on processors that multiply it.

Prompts with a mask as input are left to ONNX Runtime, see `engine.masks.mask_decoder`.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor
from torch.nn import functional

from ..install.models import one_thread

_HEADS = 8
_SIDE = 64
"""Cells of an embedding along each side. A cell has 4 x 4 low-resolution pixels."""
_PIXELS = 1024
_CELL_PIXELS = 16
"""Low-resolution pixels per cell."""
_NOT_A_POINT = -1
_CERTAIN_LOGIT = 4.0  # chosen on room_1, room_4, room_6
"""The mask's border is not near where a cell and its neighbours have higher logits, or lower than the negative."""
_UNSTABLE_BY = 0.1  # chosen on room_1, room_2, room_3, room_4, room_5, room_6, room_7, room_8, museum_room, store_room
"""How far the stability of one pixel per cell must be below the smallest allowed one that a mask is given up."""
_MIN_SAMPLES = 32  # chosen on room_1, room_2, room_3, room_4, room_5, room_6, room_7, room_8, museum_room, store_room
"""Smallest number of cells with a logit above -1 from which the stability is estimated."""
_PIECE_CELLS = 512
"""Cells that are computed together: at most 1 MB of values, which stays in the cache of a core."""

Weights = Mapping[str, NDArray[np.float32]]
Reader = Callable[[str], Tensor]
"""Returns a weight by its name."""
Linear = tuple[Tensor, Tensor]
"""Weight [in, out] and bias [out]."""


class TorchDecoder:
    """Decoder with the weights of Meta's ONNX export.

    Parameters
    ----------
    weights : mapping of str to float32 array
        From `models.read_onnx_weights`.
    bfloat16 : bool
        Compute the picture in bfloat16 instead of float32.

    Raises
    ------
    KeyError
        When a weight is missing: the file has another structure.
    """

    def __init__(self, weights: Weights, *, bfloat16: bool = False) -> None:
        self._dtype = torch.bfloat16 if bfloat16 else torch.float32

        def exact(name: str) -> Tensor:
            return torch.from_numpy(np.array(weights[name]))

        def tensor(name: str) -> Tensor:
            return exact(name).to(self._dtype)

        prompts, decoder = "model.prompt_encoder.", "mask_decoder."
        self._gaussian = exact(prompts + "pe_layer.positional_encoding_gaussian_matrix")
        self._kinds = [exact(f"{prompts}point_embeddings.{kind}.weight")[0] for kind in range(4)]
        self._not_a_point = exact(prompts + "not_a_point_embed.weight")[0]
        # The exporter folded these into tensors without a name of their own.
        self._no_mask = tensor("/Mul_9:1").reshape(-1)
        self._tokens = exact("/Expand_1:0")[0]
        layers = [f"transformer.layers.{index}." for index in (0, 1)]
        self._layers = [_Layer(tensor, prefix) for prefix in layers]
        self._final = _Attention(tensor, "transformer.final_attn_token_to_image.")
        self._final_norm = _norm(tensor, "transformer.norm_final_attn.")
        upscaling = decoder + "output_upscaling."
        self._enlarge_first = _enlarging(tensor(upscaling + "0.weight"), tensor(upscaling + "0.bias"))
        self._enlarge_norm = (
            tensor("/output_upscaling/output_upscaling.1/Mul:0").reshape(-1),
            tensor("/output_upscaling/output_upscaling.1/Add_1:1").reshape(-1),
        )
        self._enlarge_second = _enlarging(tensor(upscaling + "3.weight"), tensor(upscaling + "3.bias"))
        self._mask_heads = [_mlp(exact, f"{decoder}output_hypernetworks_mlps.{index}.") for index in range(4)]
        self._iou_head = _mlp(exact, decoder + "iou_prediction_head.")
        centres = (torch.arange(_SIDE) + 0.5) / _SIDE
        y, x = torch.meshgrid(centres, centres, indexing="ij")
        self._all_places = self._encode_places(torch.stack([x, y], dim=-1).reshape(-1, 2)).to(self._dtype)
        self._prepared: tuple[NDArray[np.float32], int, int] | None = None

    def decode(
        self,
        features: NDArray[np.float32],
        coordinates: NDArray[np.float32],
        labels: NDArray[np.float32],
        cells: tuple[int, int] | None = None,
        min_stability: float = 0.0,
    ) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
        """Return the mask of a prompt, as Meta's decoder with one mask per prompt.

        Parameters
        ----------
        features : array of shape [1, 256, 64, 64], float32
            The same array again costs less.
        coordinates : array of shape [1, n, 2], float32
            x, y in pixels of the encoder's frame.
        labels : array of shape [1, n], float32
        cells : (int, int) or None
            Rows and columns of cells, 1 to 64, that show the photo; None for all. The others are padding, which keeps
            the values that it has for a click in the middle of the photo. Logits that are far from 0 are then computed
            for one pixel per cell.
        min_stability : float
            The smallest stability that the caller accepts. With `cells`, a mask that is clearly below has one logit per
            cell, which is below too.

        Returns
        -------
        logits : array of shape [1, 256, 256], float32
            0 outside of `cells`.
        ious : array of shape [1], float32
            Predicted IoU.
        """
        rows, columns = cells or (_SIDE, _SIDE)
        with one_thread(), torch.inference_mode():
            if self._prepared is None or self._prepared[0] is not features or self._prepared[1:] != (rows, columns):
                self._prepare(features, rows, columns)
            tokens, picture = self._transform(self._prompt(coordinates[0], labels[0]))
            ious = _apply_mlp(tokens[0], self._iou_head)
            # Meta's rule: the first mask is for unambiguous prompts, of more than a click with its padding or a box.
            best = 1 + int(ious[1:].argmax()) if labels.shape[1] <= 2 else 0
            mask_head = _apply_mlp(tokens[1 + best], self._mask_heads[best]).to(self._dtype)
            if cells is None:
                pixels = self._enlarged(picture, mask_head)
            else:
                pixels = self._enlarged_at_border(picture, mask_head, rows, columns, min_stability)
            # Both enlargements double rows and columns of a cell: [y, x, y of the first, x, y of the second, x].
            pixels = pixels.reshape(rows, columns, 2, 2, 2, 2).permute(0, 2, 4, 1, 3, 5)
            logits = np.zeros((1, 4 * _SIDE, 4 * _SIDE), np.float32)
            logits[0, : 4 * rows, : 4 * columns] = pixels.reshape(4 * rows, 4 * columns).float().numpy()
            return logits, ious[best : best + 1].numpy()

    def _prompt(self, coordinates: NDArray[np.float32], labels: NDArray[np.float32]) -> Tensor:
        """Return the tokens of a prompt: for IoU and masks, then one per point; [t, 256]."""
        places = self._encode_places(torch.from_numpy((coordinates + 0.5) / _PIXELS))
        points = [
            self._not_a_point if kind == _NOT_A_POINT else place + self._kinds[int(kind)]
            for kind, place in zip(labels, places, strict=True)
        ]
        return torch.cat([self._tokens, torch.stack(points)])

    def _prepare(self, features: NDArray[np.float32], rows: int, columns: int) -> None:
        # Cells of the photo first.
        shown = torch.zeros((_SIDE, _SIDE), dtype=torch.bool)
        shown[:rows, :columns] = True
        order = torch.argsort(~shown.reshape(-1), stable=True)
        cells = torch.from_numpy(features.reshape(features.shape[1], -1)).T[order]
        self._picture = cells.to(self._dtype) + self._no_mask
        self._places = self._all_places[order]
        placed = self._picture + self._places
        first = self._layers[0]
        self._keys = _heads(_linear(placed, first.to_picture.key)).contiguous()
        self._values = _heads(_linear(self._picture, first.to_picture.value)).contiguous()
        self._queries = _heads(_linear(placed, first.to_tokens.query)).contiguous()
        # The picture after both layers, each without and with places. Reused by every prompt: fresh memory of this size
        # costs more than the operations that fill it.
        self._seen = [torch.empty_like(self._picture) for _ in range(4)]
        self._n_shown = _SIDE * _SIDE
        if rows * columns < self._n_shown:
            middle = np.array([[columns, rows], [0.0, 0.0]], np.float32) * (_PIXELS / _SIDE / 2.0)
            self._transform(self._prompt(middle, np.array([1.0, _NOT_A_POINT], np.float32)))
            self._n_shown = rows * columns
        self._prepared = features, rows, columns

    def _transform(self, prompt: Tensor) -> tuple[Tensor, Tensor]:
        """Return tokens [5, 256], float32, and the photo's cells [n, 256] after the two-way transformer."""
        prompt = prompt.to(self._dtype)
        first, second = self._layers
        photo = slice(0, self._n_shown)
        picture, placed, last_picture, last_placed = self._seen
        tokens = _normed(first.self_attention(prompt, prompt, prompt), first.norms[0])
        query = first.to_picture.split_query(tokens + prompt)
        attention = (query @ self._keys.transpose(1, 2)).softmax(dim=-1)
        tokens = _normed(tokens + first.to_picture.joined(attention @ self._values), first.norms[1])
        tokens = first.perceptron(tokens)
        keys, values = first.to_tokens.tokens(tokens + prompt, tokens)
        scores = keys @ self._queries[:, photo].transpose(1, 2)
        first.to_tokens.write(self._picture[photo], scores, values, first.norms[3], out=picture[photo])

        torch.add(picture[photo], self._places[photo], out=placed[photo])
        query = tokens + prompt
        tokens = _normed(tokens + second.self_attention(query, query, tokens), second.norms[0])
        tokens = _normed(tokens + second.to_picture.look(tokens + prompt, placed, picture), second.norms[1])
        tokens = second.perceptron(tokens)
        keys, values = second.to_tokens.tokens(tokens + prompt, tokens)
        scores = second.to_tokens.scores_of_picture(keys, placed[photo])
        second.to_tokens.write(picture[photo], scores, values, second.norms[3], out=last_picture[photo])

        torch.add(last_picture[photo], self._places[photo], out=last_placed[photo])
        # The prompt's own tokens are not used any more.
        used = slice(0, len(self._tokens))
        seen = self._final.look((tokens + prompt)[used], last_placed, last_picture)
        return _normed(tokens[used] + seen, self._final_norm).float(), last_picture[photo]

    def _enlarged(self, cells: Tensor, mask_head: Tensor) -> Tensor:
        """Return the logits [n, 16] of cells [n, 256] for the output [32] of a mask head."""
        pieces = []
        for piece in cells.split(_PIECE_CELLS):
            weight, bias = self._enlarge_first
            halves = torch.addmm(bias, piece, weight).reshape(4 * len(piece), -1)
            halves = functional.gelu(functional.layer_norm(halves, halves.shape[1:], *self._enlarge_norm, eps=1e-6))
            weight, bias = self._enlarge_second
            quarters = functional.gelu(torch.addmm(bias, halves, weight))
            pieces.append((quarters.reshape(-1, len(mask_head)) @ mask_head).reshape(len(piece), -1))
        return torch.cat(pieces)

    def _enlarged_at_border(
        self, cells: Tensor, mask_head: Tensor, rows: int, columns: int, min_stability: float
    ) -> Tensor:
        """Return the result of `_enlarged`, with one logit per cell where the mask's border is not near.

        Everywhere in a mask that is clearly less stable than `min_stability`: its border is near in most cells.
        """
        sample = self._sampled(cells, mask_head)
        certain, possible = (int((sample > threshold).sum()) for threshold in (1.0, -1.0))
        if possible >= _MIN_SAMPLES and certain < (min_stability - _UNSTABLE_BY) * possible:
            return sample[:, None].repeat(1, _CELL_PIXELS)
        grid = sample.reshape(1, 1, rows, columns)
        highest, lowest = (sign * functional.max_pool2d(sign * grid, 3, stride=1, padding=1) for sign in (1.0, -1.0))
        near = ((highest > -_CERTAIN_LOGIT) & (lowest < _CERTAIN_LOGIT)).reshape(-1).nonzero()[:, 0]
        pixels = sample[:, None].repeat(1, _CELL_PIXELS)
        if len(near):
            pixels[near] = self._enlarged(cells[near], mask_head)
        return pixels

    def _sampled(self, cells: Tensor, mask_head: Tensor) -> Tensor:
        """Return the logit [n] of the pixel in row 2 and column 2 of each cell [n, 256]."""
        weight, bias = self._enlarge_first
        n_halves, n_quarters = len(self._enlarge_norm[0]), len(mask_head)
        # The last of the first enlargement's four outputs, and the first of the second's.
        halves = torch.addmm(bias[-n_halves:], cells, weight[:, -n_halves:])
        halves = functional.gelu(functional.layer_norm(halves, halves.shape[1:], *self._enlarge_norm, eps=1e-6))
        weight, bias = self._enlarge_second
        return functional.gelu(torch.addmm(bias[:n_quarters], halves, weight[:, :n_quarters])) @ mask_head

    def _encode_places(self, places: Tensor) -> Tensor:
        """Return the encoding [n, 256] of places [n, 2] in the encoder's frame, x, y from 0 to 1."""
        angles = 2.0 * math.pi * ((2.0 * places - 1.0) @ self._gaussian)
        return torch.cat([angles.sin(), angles.cos()], dim=-1)


class _Attention:
    """Attention with 8 heads between tokens and the picture, or among tokens."""

    def __init__(self, read: Reader, prefix: str) -> None:
        self.query, self.key, self.value, self.out = (
            _projection(read, f"{prefix}{part}_proj") for part in ("q", "k", "v", "out")
        )
        self._scale = math.sqrt(self.query[0].shape[1] // _HEADS)

    def __call__(self, query: Tensor, key: Tensor, value: Tensor) -> Tensor:
        scores = self.split_query(query) @ _heads(_linear(key, self.key)).transpose(1, 2)
        return self.joined(scores.softmax(dim=-1) @ _heads(_linear(value, self.value)))

    def split_query(self, query: Tensor) -> Tensor:
        return _heads(_linear(query, self.query)) / self._scale

    def joined(self, heads: Tensor) -> Tensor:
        """Return the output [t, 256] for the values [8, t, c] that each head has seen."""
        return _linear(heads.transpose(0, 1).reshape(heads.shape[1], -1), self.out)

    def look(self, query: Tensor, placed: Tensor, picture: Tensor) -> Tensor:
        """Return what tokens [t, 256] see in the picture [n, 256], whose keys are those of `placed`.

        The bias of the keys changes all scores of a token by the same number, which softmax ignores.
        """
        n_tokens = len(query)
        directions = torch.bmm(self.split_query(query), _by_head(self.key[0]).transpose(1, 2))
        attention = (directions.reshape(_HEADS * n_tokens, -1) @ placed.T).softmax(dim=-1)
        seen = (attention @ picture).reshape(_HEADS, n_tokens, -1)
        return self.joined(seen @ _by_head(self.value[0]) + self.value[1].reshape(_HEADS, 1, -1))

    def tokens(self, key: Tensor, value: Tensor) -> tuple[Tensor, Tensor]:
        """Return scaled keys and values [8, t, c] of tokens [t, 256], for `scores_of_picture` and `write`."""
        return _heads(_linear(key, self.key)) / self._scale, _heads(_linear(value, self.value))

    def scores_of_picture(self, keys: Tensor, placed: Tensor) -> Tensor:
        """Return the scores [8, t, n] of the picture's places as queries."""
        directions = torch.bmm(keys, _by_head(self.query[0]).transpose(1, 2)).reshape(-1, placed.shape[1])
        constants = torch.bmm(keys, self.query[1].reshape(_HEADS, -1, 1)).reshape(-1, 1)
        return torch.addmm(constants, directions, placed.T).reshape(*keys.shape[:2], -1)

    def write(self, picture: Tensor, scores: Tensor, values: Tensor, norm: Linear, *, out: Tensor) -> None:
        """Write the picture [n, 256] with what it sees of the tokens added, normalised, to `out`; changes `scores`."""
        # Softmax over few tokens is much faster with the picture's places last in memory.
        scores -= scores.amax(dim=1, keepdim=True)
        scores.exp_()
        scores /= scores.sum(dim=1, keepdim=True)
        written = values @ self.out[0].reshape(_HEADS, -1, self.out[0].shape[1])
        # The weights of a head add up to 1, so one head can carry the bias.
        written[0] += self.out[1]
        written = written.reshape(-1, written.shape[2])
        attention = scores.reshape(len(written), -1)
        for start in range(0, len(picture), _PIECE_CELLS):
            piece = slice(start, start + _PIECE_CELLS)
            out[piece] = _normed(torch.addmm(picture[piece], attention[:, piece].T, written), norm)


class _Layer:
    """One layer of the two-way transformer."""

    def __init__(self, read: Reader, prefix: str) -> None:
        self.self_attention = _Attention(read, prefix + "self_attn.")
        self.to_picture = _Attention(read, prefix + "cross_attn_token_to_image.")
        self.to_tokens = _Attention(read, prefix + "cross_attn_image_to_token.")
        self.norms = [_norm(read, f"{prefix}norm{number}.") for number in (1, 2, 3, 4)]
        self._hidden, self._output = (_projection(read, f"{prefix}mlp.lin{number}") for number in (1, 2))

    def perceptron(self, tokens: Tensor) -> Tensor:
        return _normed(tokens + _linear(_linear(tokens, self._hidden).relu_(), self._output), self.norms[2])


def _projection(read: Reader, name: str) -> Linear:
    """Return a linear layer. The exporter keeps the name of the bias; the transposed weight is found by its node."""
    weight = read("/" + name.replace(".", "/").replace("layers/", "layers.") + "/MatMul:1")
    return weight, read(f"mask_decoder.{name}.bias")


def _norm(read: Reader, prefix: str) -> Linear:
    return read(f"mask_decoder.{prefix}weight"), read(f"mask_decoder.{prefix}bias")


def _mlp(read: Reader, prefix: str) -> list[Linear]:
    names = [f"{prefix}layers.{index}" for index in range(3)]
    return [(read(f"{name}.weight").T.contiguous(), read(f"{name}.bias")) for name in names]


def _enlarging(weight: Tensor, bias: Tensor) -> Linear:
    """Return a transposed convolution [in, out, 2, 2] with stride 2 as a product: its four outputs do not overlap."""
    return weight.permute(0, 2, 3, 1).reshape(len(weight), -1).contiguous(), bias.repeat(4)


def _apply_mlp(vector: Tensor, layers: list[Linear]) -> Tensor:
    for index, (weight, bias) in enumerate(layers):
        vector = (vector.relu() if index else vector) @ weight + bias
    return vector


def _linear(values: Tensor, layer: Linear) -> Tensor:
    return torch.addmm(layer[1], values, layer[0])


def _normed(values: Tensor, norm: Linear) -> Tensor:
    return functional.layer_norm(values, values.shape[1:], *norm)


def _heads(values: Tensor) -> Tensor:
    """Return [n, 8 c] as [8, n, c]."""
    return values.reshape(len(values), _HEADS, -1).transpose(0, 1)


def _by_head(weight: Tensor) -> Tensor:
    """Return a weight [256, 8 c] as [8, 256, c]."""
    return weight.reshape(len(weight), _HEADS, -1).transpose(0, 1)
