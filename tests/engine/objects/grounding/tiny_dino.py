"""A Grounding DINO with a few thousand random weights, its vocabulary, and its ONNX export."""

from __future__ import annotations

import functools
import tempfile
import warnings
from pathlib import Path
from typing import Any

import onnx
import torch
import transformers

SIDE, MAX_TOKENS = 96, 32
# The model separates phrases at these ids of bert-base-uncased, so the vocabulary must use the same ids.
_SPECIAL = {0: "[PAD]", 100: "[UNK]", 101: "[CLS]", 102: "[SEP]", 103: "[MASK]", 1012: ".", 1029: "?"}
_WORDS = ("a", "the", "red", "blue", "old", "vase", "head", "statue", "of", "woman", "s", "'", "-", ",", "ca", "##fe")
_WORDS += ("##s", "18", "##th", "century", "vas", "##en")
_INPUTS = ("pixel_values", "input_ids", "token_type_ids", "attention_mask", "pixel_mask")


def tokenizer(folder: Path) -> Any:
    """Return a BERT tokenizer of `transformers`; write its ``tokenizer.json`` into `folder`."""
    pieces = dict(_SPECIAL) | {200 + i: word for i, word in enumerate(_WORDS)}
    vocabulary = {pieces.get(i, f"[unused{i}]"): i for i in range(1030)}
    bert = transformers.BertTokenizer(vocab=vocabulary, do_lower_case=True)
    bert.backend_tokenizer.save(str(folder / "tokenizer.json"))
    return bert


def model() -> Any:
    """Return the torch model."""
    backbone = {
        "model_type": "swin", "image_size": SIDE, "embed_dim": 8, "depths": [1, 1, 1, 1], "num_heads": [1, 1, 2, 2],
        "window_size": 4, "out_features": ["stage2", "stage3", "stage4"],
    }  # fmt: skip
    text = {
        "model_type": "bert", "vocab_size": 1030, "hidden_size": 32, "num_hidden_layers": 1, "num_attention_heads": 2,
        "intermediate_size": 32, "max_position_embeddings": 64,
    }  # fmt: skip
    torch.manual_seed(5)
    config = transformers.GroundingDinoConfig(
        backbone_config=backbone, text_config=text, d_model=32, encoder_layers=1, encoder_ffn_dim=32,
        encoder_attention_heads=2, decoder_layers=2, decoder_ffn_dim=32, decoder_attention_heads=2, num_queries=40,
        max_text_len=MAX_TOKENS, disable_custom_kernels=True,
    )  # fmt: skip
    return transformers.GroundingDinoForObjectDetection(config).eval()


class _Outputs(torch.nn.Module):
    """The model with the two outputs of public exports."""

    def __init__(self, model: torch.nn.Module) -> None:
        super().__init__()
        self.model = model

    def forward(self, *given: torch.Tensor) -> tuple[torch.Tensor, torch.Tensor]:
        out = self.model(**dict(zip(_INPUTS, given, strict=True)))
        return out.logits, out.pred_boxes


def _phrase_mask(ids: torch.Tensor, special_tokens: torch.Tensor) -> tuple[torch.Tensor, torch.Tensor]:
    """Return the same masks as the function of transformers, without isin, cummax and eye, which ONNX lacks here."""
    special = (ids.unsqueeze(-1) == special_tokens).any(-1)
    count = ids.shape[1]
    place = torch.arange(count)
    i, j = place[:, None], place[None]
    before = torch.where(special[:, None] & (j < i)[None], j[None], -1).amax(-1)
    after = torch.where(special[:, None] & (j >= i)[None], j[None], count).amin(-1)
    inside = (after != 0) & (after != count - 1) & (after != count)
    mask = ((after.unsqueeze(2) == after.unsqueeze(1)) & inside.unsqueeze(1)) | (i == j)[None]
    return mask, torch.where(inside, place[None] - before - 1, 0).clamp(min=0)


@functools.cache
def exported() -> bytes:
    """Return the ONNX file of `model`, whose weights are the same each time."""
    with tempfile.TemporaryDirectory() as folder:
        export(model(), Path(folder) / "tiny.onnx")
        return (Path(folder) / "tiny.onnx").read_bytes()


def export(dino: Any, path: Path) -> None:
    """Write `dino` as ONNX with fixed 96 x 96 pixels and 32 tokens; public exports have 800 x 800 and 256."""
    from transformers.models.grounding_dino import modeling_grounding_dino

    original = modeling_grounding_dino.generate_masks_with_special_tokens_and_transfer_map
    special = torch.tensor(modeling_grounding_dino.SPECIAL_TOKENS)
    for ids in ([[101, 200, 201, 1012, 102]], [[101, 200, 1012, 201, 202, 1029, 102, 0, 0]]):
        for ours, theirs in zip(
            _phrase_mask(torch.tensor(ids), special), original(torch.tensor(ids), special), strict=True
        ):
            assert torch.equal(ours, theirs)
    ids = torch.zeros(1, MAX_TOKENS, dtype=torch.int64)
    ids[0, :4] = torch.tensor([101, 205, 1012, 102])
    given = (
        torch.rand(1, 3, SIDE, SIDE), ids, torch.zeros_like(ids), (ids != 0).long(),
        torch.ones(1, SIDE, SIDE, dtype=torch.int64),
    )  # fmt: skip
    modeling_grounding_dino.generate_masks_with_special_tokens_and_transfer_map = _phrase_mask
    try:
        with warnings.catch_warnings():
            warnings.simplefilter(
                "ignore"
            )  # the tracer warns of each shape that it treats as constant, which is intended
            torch.onnx.export(
                _Outputs(dino).eval(), given, str(path), input_names=list(_INPUTS),
                output_names=["logits", "pred_boxes"], opset_version=17, dynamo=False,
            )  # fmt: skip
    finally:
        modeling_grounding_dino.generate_masks_with_special_tokens_and_transfer_map = original
    _with_single_precision_grids(path)


def _with_single_precision_grids(path: Path) -> None:
    """Cast the sampling grids of the deformable attention to float32: tracing makes them float64, unsupported here."""
    graph = onnx.load(str(path))
    nodes = []
    for number, node in enumerate(graph.graph.node):
        if node.op_type == "GridSample":
            name = f"grid_{number}"
            nodes.append(onnx.helper.make_node("Cast", [node.input[1]], [name], to=onnx.TensorProto.FLOAT))
            node.input[1] = name
        nodes.append(node)
    del graph.graph.node[:]
    graph.graph.node.extend(nodes)
    onnx.save(graph, str(path))
