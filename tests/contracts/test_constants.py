"""Every number of the method says where its value comes from, and none was chosen on data that tests the method.

docs/constants.md explains the tags and the sets. A tag is the comment behind a number: ``# chosen on SET, SET``,
``# published: AUTHOR YEAR`` or ``# by definition``; several are separated by semicolons. It stands on the line of the
number, or on the last line of the statement for all its numbers without a tag on their own line.
"""

from __future__ import annotations

import ast
import io
import re
import tokenize
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[2]

KERNELS = (
    "training/gpu",
    "training/adam.py",
    "training/losses/photometric.py",
    "training/losses/photometric_kernels.py",
)
"""Kernels and their buffers, whose numbers decide nothing but speed or are those of a formula, as in `rasterizer`."""

LEAST_CONSTANTS = {"training": 100, "planning": 60, "grounding": 35, "objects": 30, "words": 3}
"""Packages of the engine that are read, and the statements with numbers that each has at least. There are more now;
fewer mean that the guard does not see them any more."""

SETS = frozenset({
    *(f"room_{number}" for number in range(1, 9)),
    "more_rooms", "museum_room", "store_room",
    "banana16", "herz_jesus25", "meeting_place9", "sakharov_statue32", "skull66",
    "stability_scenes", "sky_scene", "prompt_words",
})  # fmt: skip
"""Data that values may be chosen on; docs/constants.md says what each is. Test rooms and sets that are kept for
evaluation are not among them."""

PUBLICATIONS = frozenset({
    "Dahaghin et al. 2024", "Kerbl et al. 2023", "Kheradmand et al. 2024", "Liu et al. 2023", "Tan and Le 2019",
    "Ye et al. 2024",
})  # fmt: skip
"""Works that values may be taken from: the paper, or the code that its authors released with it."""

_TAG_START = re.compile(r"(chosen on|published|by definition)\b")
_PARSES_TEXT = frozenset({"float", "int", "complex", "Decimal", "Fraction", "float32", "float64"})
"""Functions that make a number of a string."""
_CHANGES_SETTINGS = ("replace", "changed")
"""Functions whose keyword arguments are settings, besides the classes of settings themselves."""


@dataclass(frozen=True)
class Constant:
    """Numbers that one statement, or one header of a function or a block, evaluates when the module is imported.

    Attributes
    ----------
    lines : tuple of int
        Lines of the numbers.
    last_line : int
        Last line of the statement or header.
    """

    lines: tuple[int, ...]
    last_line: int


class _Constants(ast.NodeVisitor):
    """Collects what is evaluated on import: everything but annotations and the bodies of functions."""

    def __init__(self) -> None:
        self.found: list[Constant] = []
        self._in_settings = False

    def visit_ClassDef(self, node: ast.ClassDef) -> None:
        header = [*node.decorator_list, *node.bases, *(keyword.value for keyword in node.keywords)]
        self._note(header, _header_end(node))
        outer, self._in_settings = self._in_settings, node.name.endswith("Settings")
        for statement in node.body:
            self.visit(statement)
        self._in_settings = outer

    def visit_FunctionDef(self, node: ast.FunctionDef | ast.AsyncFunctionDef) -> None:
        defaults = [*node.args.defaults, *(default for default in node.args.kw_defaults if default is not None)]
        self._note([*node.decorator_list, *defaults], _header_end(node))

    def visit_AsyncFunctionDef(self, node: ast.AsyncFunctionDef) -> None:
        self.visit_FunctionDef(node)

    def generic_visit(self, node: ast.AST) -> None:
        if not isinstance(node, ast.stmt):  # the module, a handler of exceptions, a case of a match
            super().generic_visit(node)
        elif isinstance(node, ast.AnnAssign):
            value = [] if node.value is None else [node.value]
            self._note(value, node.end_lineno or node.lineno, is_setting=self._in_settings)
        elif hasattr(node, "body") or isinstance(node, ast.Match):
            children = list(ast.iter_child_nodes(node))
            inner = [child for child in children if isinstance(child, ast.stmt | ast.ExceptHandler | ast.match_case)]
            self._note([child for child in children if child not in inner], _header_end(node))
            for child in inner:
                self.visit(child)
        else:
            self._note([node], node.end_lineno or node.lineno)

    def _note(self, nodes: Sequence[ast.AST], last_line: int, *, is_setting: bool = False) -> None:
        values = [value for node in nodes for value in _values(node)]
        if is_setting:
            values += [value for node in nodes for value in _default(node)]
        lines = sorted({value.lineno for value in values})
        if lines:
            self.found.append(Constant(tuple(lines), max(last_line, *lines)))


def _header_end(node: ast.stmt) -> int:
    """Return the last line of what stands before the body of a compound statement."""
    body: list[ast.AST] = getattr(node, "body", None) or getattr(node, "cases", [])
    first = min(getattr(child, "lineno", None) or child.pattern.lineno for child in body)  # type: ignore[attr-defined]
    return max(node.lineno, first - 1)


def _values(node: ast.AST) -> Iterator[ast.expr]:
    """Yield the numbers in a node, and the settings that a call such as ``replace(BETTER, keep_given=False)`` gives."""
    if isinstance(node, ast.Subscript) and _name(node.value) == "Literal":
        return  # a type
    if isinstance(node, ast.Constant) and isinstance(node.value, int | float | complex):
        if not isinstance(node.value, bool):
            yield node
    elif isinstance(node, ast.Call):
        called = _called(node)
        if called in _PARSES_TEXT:
            texts = (value for value in node.args if isinstance(value, ast.Constant))
            yield from (text for text in texts if isinstance(text.value, str))
        if called in _CHANGES_SETTINGS or called.endswith("Settings"):
            yield from (keyword.value for keyword in node.keywords if isinstance(keyword.value, ast.Constant))
    for child in ast.iter_child_nodes(node):
        yield from _values(child)


def _default(node: ast.AST) -> Iterator[ast.expr]:
    """Yield the default of a field of settings where it is a constant of any type: a number, a name, a switch."""
    if isinstance(node, ast.Constant):
        yield node
    elif isinstance(node, ast.Call) and _called(node) == "field":
        for keyword in node.keywords:
            if keyword.arg == "default":
                yield from _default(keyword.value)


def _called(node: ast.AST) -> str:
    return _name(node.func) if isinstance(node, ast.Call) else ""


def _name(node: ast.expr) -> str:
    """Return the last part of a name: ``replace`` of ``dataclasses.replace``."""
    return node.attr if isinstance(node, ast.Attribute) else node.id if isinstance(node, ast.Name) else ""


def constants(source: str) -> list[Constant]:
    """Return the constants of a module in the order of their lines."""
    visitor = _Constants()
    visitor.visit(ast.parse(source))
    return sorted(visitor.found, key=lambda constant: constant.lines)


def comments(source: str) -> tuple[dict[int, str], set[int]]:
    """Return the comment behind the code of each line, and the lines that have code."""
    behind: dict[int, str] = {}
    with_code: set[int] = set()
    skipped = {tokenize.COMMENT, tokenize.NL, tokenize.NEWLINE, tokenize.INDENT, tokenize.DEDENT, tokenize.ENDMARKER}
    for token in tokenize.generate_tokens(io.StringIO(source).readline):
        if token.type not in skipped:
            with_code.update(range(token.start[0], token.end[0] + 1))
        elif token.type == tokenize.COMMENT and token.start[0] in with_code:
            behind[token.start[0]] = token.string
    return behind, with_code


def tags_of(comment: str) -> list[str]:
    """Return the tags of a comment, well-formed or not; parts such as ``noqa: N802`` are no tags."""
    parts = (part.strip() for part in comment.split("#"))
    return [tag.strip() for part in parts if _TAG_START.match(part) for tag in part.split(";")]


def problem_of(tag: str) -> str | None:
    """Return what is wrong with a tag, None when it is right."""
    if tag == "by definition":
        return None
    kind, _, rest = tag.partition("chosen on " if tag.startswith("chosen on ") else ": ")
    if tag.startswith("chosen on "):
        unknown = [name for name in (name.strip() for name in rest.split(",")) if name not in SETS]
        return f"no value may be chosen on {', '.join(map(repr, unknown))}" if unknown else None
    if kind == "published":
        return None if rest in PUBLICATIONS else f"{rest!r} is not among the publications"
    return f"{tag!r} is no tag"


def problems(source: str) -> list[tuple[int, str]]:
    """Return line and complaint for each number without a right tag, and for each tag without a number."""
    behind, with_code = comments(source)
    tags = {line: found for line, comment in behind.items() if (found := tags_of(comment))}
    wrong = [(line, what) for line, found in tags.items() for tag in found if (what := problem_of(tag))]
    used: set[int] = set()
    for constant in constants(source):
        end = max(line for line in with_code if line <= constant.last_line)
        for line in constant.lines:
            place = line if line in tags else end
            used.add(place)
            if place not in tags:
                wrong.append((line, "a number without a tag"))
    wrong += [(line, "a tag without a number") for line in tags if line not in used]
    return sorted(wrong)


def modules() -> Iterator[tuple[str, Path]]:
    """Yield the package and the path of every module that is read."""
    for package in LEAST_CONSTANTS:
        for path in sorted((ROOT / "engine" / package).rglob("*.py")):
            if not any(path.is_relative_to(ROOT / "engine" / part) for part in KERNELS):
                yield package, path


def test_every_number_says_where_its_value_comes_from() -> None:
    found = [
        f"{path.relative_to(ROOT)}:{line}: {what}"
        for _, path in modules()
        for line, what in problems(path.read_text(encoding="utf-8"))
    ]
    assert found == [], f"{len(found)} places, see docs/constants.md:\n" + "\n".join(found)


def test_guard_sees_the_numbers_of_each_package() -> None:
    seen = dict.fromkeys(LEAST_CONSTANTS, 0)
    for package, path in modules():
        seen[package] += len(constants(path.read_text(encoding="utf-8")))
    too_few = {package: n for package, n in seen.items() if n < LEAST_CONSTANTS[package]}
    assert too_few == {}, f"of {seen}"


def test_document_says_what_each_set_and_publication_is() -> None:
    text = (ROOT / "docs" / "constants.md").read_text(encoding="utf-8")
    named = {name for name in SETS if not name.startswith("room_")} | {"room_1", "room_8"} | PUBLICATIONS
    assert {name for name in named if name not in text} == set()


PLAIN = "_LIMIT = 0.45  # {}\n"
IN_SETTINGS = "class SegmentSettings:\n    least_score: float = 0.45  # {}\n"


@pytest.mark.parametrize("module", [PLAIN, IN_SETTINGS], ids=["constant", "setting"])
@pytest.mark.parametrize(
    "tag",
    [
        "chosen on test_room_1",
        "chosen on test_room",
        "chosen on museum_room, test_room_5",
        "chosen on room_9",
        "chosen on 1734",
        "chosen on seed 1734",
        "chosen on gallery",
        "chosen on fountain",
        "chosen on toy",
        "chosen on store_room, fountain",
        "chosen on Museum_Room",
        "chosen on",
        "chosen on museum_room,",
        "chosen on museum_room; chosen on gallery",
        "published",
        "published: somebody",
        "published: Dahaghin et al. 2023",
        "by definition, roughly",
        "a limit",
        "museum_room",
    ],
)
def test_wrong_tag_is_found(module: str, tag: str) -> None:
    line = module.count("\n")
    assert line in [place for place, _ in problems(module.format(tag))]
    assert problems(module.format("chosen on museum_room")) == []


@pytest.mark.parametrize(
    "tag",
    [
        "chosen on museum_room",
        "chosen on room_1, room_8, store_room",
        "published: Kerbl et al. 2023",
        "by definition",
        "published: Dahaghin et al. 2024; chosen on museum_room",
        "by definition  # noqa: N802",
        "type: ignore[assignment]  # chosen on sakharov_statue32",
    ],
)
def test_right_tag_is_accepted(tag: str) -> None:
    assert problems(PLAIN.format(tag)) == []


@pytest.mark.parametrize(
    ("package", "setting"), [("objects", "least_score"), ("training", "cooldown"), ("grounding", "box_threshold")]
)
@pytest.mark.parametrize("planted", ["chosen on test_room_2", ""], ids=["test room", "no tag"])
def test_violation_planted_in_the_settings_is_found(package: str, setting: str, planted: str) -> None:
    source = (ROOT / "engine" / package / "settings.py").read_text(encoding="utf-8")
    assert problems(source) == []
    line = next(line for line in source.splitlines() if line.strip().startswith(f"{setting}: float = "))
    broken = line.split("#")[0] + (f"# {planted}" if planted else "")
    assert [place for place, _ in problems(source.replace(line, broken))] == [source.splitlines().index(line) + 1]


@pytest.mark.parametrize(
    "source",
    [
        "LIMIT = 3",
        "LIMIT = -0.5",
        "LIMIT: int = 3",
        "LIMIT: Final[float] = 3.0",
        "LIMIT = 1 / 160",
        "LIMIT = 980 * 735",
        "LIMIT = 2 * OTHER",
        "LIMIT = 1 << 30",
        "LIMIT = 0x10",
        "LIMIT = 1e-6",
        "LIMIT = 2j",
        "LOW, HIGH = 0.2, 0.7",
        "LOW = HIGH = 0.2",
        "SIZES = (1.0, 2.0)",
        "SIZES = [1.0, *OTHERS]",
        "SIZES = {3, 4}",
        "RATES = {'means': 0.03}",
        "RATES = {3: OTHER}",
        "RATES = dict(means=0.03)",
        "RATES['means'] = 0.03",
        "SIZES = tuple(n * 3 for n in OTHERS)",
        "SIZES = [n for n in OTHERS if n > 3]",
        "LIMIT = 3 if FAST else OTHER",
        "LIMIT = OTHER and 3",
        "LIMIT = f'{3}'",
        "LIMIT = OTHERS[2]",
        "LIMIT += 3",
        "LIMITS.append(3)",
        "globals()['LIMIT'] = 3",
        "setattr(module, 'LIMIT', 3)",
        "print(LIMIT := 3)",
        "LIMIT = float('0.45')",
        "LIMIT = Decimal('0.45')",
        "LIMIT = np.float32('0.45')",
        "LIMIT = np.float32(0.45)",
        "ARRAY = np.array([[0.1], [0.2]])",
        "LIMIT = math.log(8.0)",
        "f = lambda x: x > 3",
        "f = partial(g, 3)",
        "if FAST:\n    LIMIT = 3",
        "if FAST:\n    pass\nelse:\n    LIMIT = 3",
        "if VERSION > 3:\n    pass",
        "for N in (1, 2):\n    pass",
        "for N in OTHERS:\n    LIMIT = 3",
        "while LIMIT < 3:\n    pass",
        "with context(3):\n    pass",
        "with context():\n    LIMIT = 3",
        "try:\n    LIMIT = 3\nfinally:\n    pass",
        "try:\n    pass\nexcept ImportError:\n    LIMIT = 3",
        "try:\n    pass\nexcept ImportError:\n    pass\nelse:\n    LIMIT = 3",
        "match KIND:\n    case 'a':\n        LIMIT = 3",
        "assert LIMIT < 3",
        "def f(x=3):\n    pass",
        "def f(*, x: float = 0.1) -> None:\n    pass",
        "def f(x=3): return x",
        "async def f(x=3):\n    pass",
        "@lru_cache(maxsize=8)\ndef f():\n    pass",
        "class A:\n    limit = 3",
        "class A:\n    limit: int = 3",
        "class A:\n    limit: int = field(default=3)",
        "class A:\n    limit: list = field(default_factory=lambda: [3])",
        "class A:\n    class B:\n        limit = 3",
        "class A:\n    def f(self, x=3):\n        pass",
        "class A(Base, limit=3):\n    pass",
        "@settings(3)\nclass A:\n    pass",
        "PAPER = replace(BETTER, cosine=0.7)",
        "PAPER = dataclasses.replace(BETTER, keep_given=False)",
        "PAPER = replace(BETTER, refinement='none')",
        "PAPER = SegmentSettings(outlier_iqr=None)",
        "PRESETS = {'best': STANDARD.changed(exposure=True)}",
        "class SegmentSettings:\n    keep_given: bool = True",
        "class SegmentSettings:\n    refinement: Literal['none', 'votes'] = 'votes'",
        "class SegmentSettings:\n    outlier_iqr: float | None = None",
        "class SegmentSettings:\n    exposure: bool = field(default=False, metadata={'stored_as': 'x'})",
    ],
)  # fmt: skip
def test_number_without_a_tag_is_found(source: str) -> None:
    found = problems(source + "\n")
    assert [what for _, what in found] == ["a number without a tag"]
    lines = source.splitlines()
    for tag, right in (("by definition", True), ("chosen on test_room_1", False)):
        lines[found[0][0] - 1] += f"  # {tag}"
        assert (problems("\n".join(lines)) == []) is right
        lines = source.splitlines()


@pytest.mark.parametrize(
    "source",
    [
        "LIMIT = OTHER",
        "LIMIT = SETTINGS.limit",
        "LIMIT = math.inf",
        "LIMIT = OTHER / ANOTHER",
        "NAME = 'room 3'",
        "FLAG = True",
        '"""3 Gaussians."""',
        "LIMIT: Annotated[int, 3]",
        "KINDS = Literal[1, 2]",
        "def f():\n    return 3",
        "def f(x: Literal[1, 2]) -> Literal[1, 2]:\n    y = 3",
        "class A:\n    limit: Literal[1, 2]",
        "class A:\n    def f(self):\n        self.limit = 3",
        "class A:\n    flag: bool = True",
        "class SegmentSettings:\n    loss: LossSettings = LossSettings()\n    cosine: float = COSINE",
        "from x import y",
    ],
)
def test_what_is_no_number_of_the_module_needs_no_tag(source: str) -> None:
    assert problems(source + "\n") == []


def test_tag_at_the_end_holds_for_numbers_without_their_own() -> None:
    source = "SIZES = (\n    1.0,\n    2.0,{}\n){}\n"
    assert problems(source.format("", "  # by definition")) == []
    assert problems(source.format("  # published: Kerbl et al. 2023", "  # by definition")) == []
    assert problems(source.format("  # by definition", "")) == [(2, "a number without a tag")]
    assert problems("SIZES = (  # by definition\n    1.0,\n)\n") == [
        (1, "a tag without a number"), (2, "a number without a tag"),
    ]  # fmt: skip
    assert problems("def f(\n    x=1,\n    y=2,\n) -> None:  # by definition\n    # a reason\n    pass\n") == []


@pytest.mark.parametrize(
    "source",
    [
        "NAME = 'x'  # by definition",
        "def f():\n    limit = 3  # by definition",
        "LIMIT = OTHER  # chosen on museum_room",
        "LIMIT = '3'  # by definition",
    ],
)
def test_tag_without_a_number_is_found(source: str) -> None:
    assert [what for _, what in problems(source + "\n")] == ["a tag without a number"]


@pytest.mark.parametrize(
    "source", ["# by definition\nLIMIT = 3", "LIMIT = 3\n# by definition", "LIMIT = (3, '# by definition')"]
)
def test_comment_on_a_line_of_its_own_and_text_are_no_tags(source: str) -> None:
    assert [what for _, what in problems(source + "\n")] == ["a number without a tag"]
