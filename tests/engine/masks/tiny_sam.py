"""A SAM model with about ten thousand random weights, and ONNX exports of both kinds of encoder and decoder."""

from __future__ import annotations

import warnings
from pathlib import Path
from typing import Any

import torch
import transformers
from torch import Tensor, nn

_MEAN = torch.tensor([123.675, 116.28, 103.53])
_DEVIATION = torch.tensor([58.395, 57.12, 57.375])


def model() -> Any:
    """Return the torch model: 1024 pixels and 64 x 64 cells like the real models, but 32 channels and two layers."""
    vision = {
        "hidden_size": 32, "output_channels": 32, "num_hidden_layers": 2, "num_attention_heads": 2, "window_size": 14,
        "global_attn_indexes": [], "num_pos_feats": 16, "mlp_dim": 32,
    }  # fmt: skip
    decoder = {"hidden_size": 32, "mlp_dim": 32, "num_attention_heads": 2, "iou_head_hidden_dim": 32}
    config = transformers.SamConfig(
        vision_config=vision, prompt_encoder_config={"hidden_size": 32}, mask_decoder_config=decoder
    )
    sam = transformers.SamModel(config).eval()
    generator = torch.Generator().manual_seed(3)
    with torch.no_grad():
        for parameter in sam.parameters():
            if parameter.ndim > 1:
                # The initial values of transformers are so small that every photo would give the same mask.
                parameter.normal_(0, 0.25, generator=generator)
    return sam


class _SquareEncoder(nn.Module):
    def __init__(self, sam: Any) -> None:
        super().__init__()
        self.sam = sam

    def forward(self, square: Tensor) -> Tensor:
        return self.sam.get_image_embeddings(square)


class _PhotoEncoder(_SquareEncoder):
    def forward(self, photo: Tensor) -> Tensor:
        normalised = ((photo - _MEAN) / _DEVIATION).permute(2, 0, 1)[None]
        height, width = normalised.shape[2:]
        return self.sam.get_image_embeddings(nn.functional.pad(normalised, (0, 1024 - width, 0, 1024 - height)))


class _Decoder(nn.Module):
    """Meta's interface with transformers' modules, without the enlargement to ``orig_im_size``, which is never used."""

    def __init__(self, sam: Any, *, four: bool) -> None:
        super().__init__()
        self.sam, self.four = sam, four

    def forward(
        self, features: Tensor, points: Tensor, labels: Tensor, mask: Tensor, has_mask: Tensor, size: Tensor
    ) -> tuple[Tensor, Tensor, Tensor]:
        prompts = self.sam.prompt_encoder
        kinds = labels[..., None]
        places = prompts.shared_embedding((points + 0.5)[:, None], (1024, 1024))[:, 0]
        sparse = torch.where(kinds == -1, prompts.not_a_point_embed.weight[None], places)
        for kind, embedding in enumerate(prompts.point_embed):
            sparse = sparse + (kinds == kind) * embedding.weight[None]
        plain = prompts.no_mask_embed.weight.reshape(1, -1, 1, 1)
        dense = has_mask * prompts.mask_embed(mask) + (1 - has_mask) * plain
        masks, ious = [], []
        for several in (False, True) if self.four else (False,):
            low, iou = self.sam.mask_decoder(
                image_embeddings=features,
                image_positional_embeddings=self.sam.get_image_wide_positional_embeddings(),
                sparse_prompt_embeddings=sparse[:, None],
                dense_prompt_embeddings=dense,
                multimask_output=several,
            )
            masks.append(low[:, 0])
            ious.append(iou[:, 0])
        low = torch.cat(masks, dim=1)
        return low + 0 * size.sum(), torch.cat(ious, dim=1), low


def export(sam: Any, folder: Path) -> None:
    """Write ``square.onnx`` and ``photo.onnx`` (encoders), ``one.onnx`` and ``four.onnx`` (decoders) into `folder`."""
    inputs = ["image_embeddings", "point_coords", "point_labels", "mask_input", "has_mask_input", "orig_im_size"]
    given = (
        torch.zeros(1, 32, 64, 64), torch.rand(1, 3, 2), torch.tensor([[1.0, 0, -1]]), torch.zeros(1, 1, 256, 256),
        torch.zeros(1), torch.tensor([256.0, 256.0]),
    )  # fmt: skip
    free = {"point_coords": {1: "n"}, "point_labels": {1: "n"}}
    outputs = ["masks", "iou_predictions", "low_res_masks"]
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # the tracer warns of each shape that it treats as constant, which is intended
        for name, module in (("one", _Decoder(sam, four=False)), ("four", _Decoder(sam, four=True))):
            torch.onnx.export(
                module.eval(), given, str(folder / f"{name}.onnx"), input_names=inputs, output_names=outputs,
                dynamic_axes=free, opset_version=17, dynamo=False,
            )  # fmt: skip
        torch.onnx.export(
            _SquareEncoder(sam).eval(), (torch.zeros(1, 3, 1024, 1024),), str(folder / "square.onnx"),
            input_names=["x"], output_names=["image_embeddings"], opset_version=17, dynamo=False,
        )  # fmt: skip
        torch.onnx.export(
            _PhotoEncoder(sam).eval(), (torch.zeros(768, 1024, 3),), str(folder / "photo.onnx"), opset_version=17,
            input_names=["input_image"], output_names=["image_embeddings"], dynamo=False,
            dynamic_axes={"input_image": {0: "h", 1: "w"}},
        )  # fmt: skip
