"""A CLIP and a SigLIP 2 with a few thousand random weights, their tokenizers, and their exports to ONNX in parts."""

from __future__ import annotations

import warnings
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import onnx
import torch
import transformers
from onnxruntime.transformers.float16 import convert_float_to_float16
from tokenizers import pre_tokenizers, processors

LENGTHS = {"clip": 77, "siglip": 64}
_MERGES = [
    "v a",
    "va s",
    "vas e</w>",
    "t e",
    "te a",
    "p o",
    "po t</w>",
    "tea pot</w>",
    "a n",
    "o f</w>",
    "t h",
    "th e</w>",
]


def clip_tokenizer(folder: Path) -> Any:
    """Return a CLIP tokenizer of `transformers`; write its ``tokenizer.json`` into `folder`."""
    letters = sorted(pre_tokenizers.ByteLevel.alphabet())
    pieces = [*letters, *(f"{one}</w>" for one in letters), *("".join(one.split()) for one in _MERGES)]
    vocabulary = {piece: number for number, piece in enumerate([*pieces, "<|startoftext|>", "<|endoftext|>"])}
    tokenizer = transformers.CLIPTokenizer(vocabulary, [tuple(one.split()) for one in _MERGES])
    tokenizer.backend_tokenizer.save(str(folder / "tokenizer.json"))
    return tokenizer


def siglip_tokenizer(folder: Path) -> Any:
    """Return a SigLIP 2 tokenizer of `transformers`; write a ``tokenizer.json`` as the export has it into `folder`.

    The tokenizer file of the export has no step that turns texts into lower case, unlike `transformers`' own.
    """
    special = ["<pad>", "<eos>", "<bos>", "<unk>", "<mask>"]
    letters = [*"abcdefghijklmnopqrstuvwxyzäöüß.,'-", "▁"]
    merges = ["v a", "va s", "vas e", "▁ a", "k r", "kr u", "kru g", "▁ p", "▁p h"]
    bytes_ = [f"<0x{number:02X}>" for number in range(256)]
    pieces = [*special, *bytes_, *letters, *("".join(one.split()) for one in merges)]
    tokenizer = transformers.Siglip2Tokenizer(
        {piece: number for number, piece in enumerate(pieces)}, [tuple(one.split()) for one in merges]
    )
    backend = tokenizer.backend_tokenizer
    backend.post_processor = processors.TemplateProcessing(single="$A <eos>", special_tokens=[("<eos>", 1)])
    lowering = backend.normalizer
    backend.normalizer = list(lowering)[-1]
    backend.save(str(folder / "tokenizer.json"))
    backend.normalizer = lowering
    return tokenizer


def clip(n_tokens: int) -> Any:
    """Return the torch model for a vocabulary of `n_tokens`, whose last one ends a text."""
    text = {
        "vocab_size": n_tokens, "hidden_size": 32, "intermediate_size": 32, "num_hidden_layers": 2,
        "num_attention_heads": 2, "bos_token_id": n_tokens - 2, "eos_token_id": n_tokens - 1,
    }  # fmt: skip
    vision = {
        "hidden_size": 32, "intermediate_size": 32, "num_hidden_layers": 2, "num_attention_heads": 2, "patch_size": 32,
        "image_size": 224,
    }  # fmt: skip
    torch.manual_seed(5)
    config = transformers.CLIPConfig(text_config=text, vision_config=vision, projection_dim=24)
    return _scattered(transformers.CLIPModel(config).eval())


def siglip(n_tokens: int) -> Any:
    """Return the torch model for a vocabulary of `n_tokens`."""
    text = {
        "vocab_size": n_tokens, "hidden_size": 24, "intermediate_size": 32, "num_hidden_layers": 2,
        "num_attention_heads": 2, "max_position_embeddings": 64, "projection_size": 24,
    }  # fmt: skip
    vision = {
        "hidden_size": 24, "intermediate_size": 32, "num_hidden_layers": 2, "num_attention_heads": 2, "patch_size": 32,
        "image_size": 256,
    }  # fmt: skip
    torch.manual_seed(5)
    config = transformers.SiglipConfig(text_config=text, vision_config=vision)
    return _scattered(transformers.SiglipModel(config).eval())


def _scattered(model: Any) -> Any:
    """Make the weights larger: freshly drawn ones give nearly the same vector for each input."""
    with torch.no_grad():
        for name, weight in model.named_parameters():
            if weight.ndim > 1 and "position" not in name:
                weight.mul_(2)
    return model


class _Half(torch.nn.Module):
    """One half of a model, with the outputs of public exports."""

    def __init__(self, run: Callable[[torch.Tensor], torch.Tensor], model: torch.nn.Module) -> None:
        super().__init__()
        self.model, self.run = model, run

    def forward(self, given: torch.Tensor) -> torch.Tensor:
        return self.run(given)


def export(kind: str, model: Any, folder: Path) -> tuple[Path, Path]:
    """Write the two parts of a model as ONNX, with free numbers of rows; return the files of pictures and of texts."""
    halves: dict[str, tuple[Callable[[torch.Tensor], torch.Tensor], torch.Tensor, str, str]]
    side, ids = (224 if kind == "clip" else 256), torch.ones(1, LENGTHS[kind], dtype=torch.int64)
    if kind == "clip":
        ids[0, -1] = model.config.text_config.eos_token_id
        halves = {
            "vision": (_clip_pictures(model), torch.rand(1, 3, side, side), "pixel_values", "image_embeds"),
            "text": (_clip_texts(model), ids, "input_ids", "text_embeds"),
        }
    else:
        halves = {
            "vision": (
                lambda pixels: model.vision_model(pixel_values=pixels).pooler_output,
                torch.rand(1, 3, side, side), "pixel_values", "pooler_output",
            ),
            "text": (lambda ids: model.text_model(input_ids=ids).pooler_output, ids, "input_ids", "pooler_output"),
        }  # fmt: skip
    files = []
    for name, (run, given, given_name, output) in halves.items():
        file = folder / f"{name}.onnx"
        free = {0: "batch", 1: "length"} if given.ndim == 2 and kind == "clip" else {0: "batch"}
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # the tracer warns of each shape that it treats as constant
            torch.onnx.export(
                _Half(run, model).eval(), (given,), str(file), input_names=[given_name], output_names=[output],
                dynamic_axes={given_name: free, output: {0: "batch"}}, opset_version=17, dynamo=False,
            )  # fmt: skip
        files.append(file)
    return files[0], files[1]


def _clip_pictures(model: Any) -> Callable[[torch.Tensor], torch.Tensor]:
    return lambda pixels: model.visual_projection(model.vision_model(pixel_values=pixels).pooler_output)


def _clip_texts(model: Any) -> Callable[[torch.Tensor], torch.Tensor]:
    return lambda ids: model.text_projection(model.text_model(input_ids=ids).pooler_output)


def with_four_bits(source: Path, target: Path) -> int:
    """Write a model with the weights of its products in 4 bits, in blocks of 32, and all else in 16 bits.

    Returns the number of products, `MatMulNBits` of onnxruntime.
    """
    model = onnx.load(str(source))
    graph, block = model.graph, 32
    weights = {one.name: one for one in graph.initializer}
    nodes, count = [], 0
    for node in graph.node:
        if node.op_type != "MatMul" or node.input[1] not in weights:
            nodes.append(node)
            continue
        values = onnx.numpy_helper.to_array(weights[node.input[1]])
        rows, columns = values.shape
        blocks = -(-rows // block)
        padded = np.zeros((blocks * block, columns), np.float32)
        padded[:rows] = values
        each = padded.T.reshape(columns, blocks, block)
        scales = np.maximum(np.abs(each).max(axis=2) / 7, 1e-6).astype(np.float32)
        whole = np.clip(np.rint(each / scales[..., None]) + 8, 0, 15).astype(np.uint8)
        packed = whole[..., 0::2] | (whole[..., 1::2] << 4)
        names = [f"{node.name}_packed", f"{node.name}_scales"]
        graph.initializer.append(onnx.numpy_helper.from_array(packed, names[0]))
        graph.initializer.append(onnx.numpy_helper.from_array(scales.reshape(-1), names[1]))
        sizes = {"K": rows, "N": columns, "bits": 4, "block_size": block}
        inputs = [node.input[0], *names]
        nodes.append(onnx.helper.make_node("MatMulNBits", inputs, node.output, domain="com.microsoft", **sizes))
        count += 1
    del graph.node[:]
    graph.node.extend(nodes)
    model.opset_import.append(onnx.helper.make_opsetid("com.microsoft", 1))
    onnx.save(convert_float_to_float16(model, keep_io_types=True, disable_shape_infer=True), str(target))
    return count
