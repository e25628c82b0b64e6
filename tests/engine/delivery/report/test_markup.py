"""Values are escaped by construction: only `engine.delivery.report.markup` makes HTML of text."""

from __future__ import annotations

import ast
from pathlib import Path

import pytest

from engine.delivery.report.markup import Html, fill, joined

PAGE = Path(__file__).parents[4] / "engine" / "delivery" / "report" / "page.py"


def test_values_are_escaped_and_html_is_not() -> None:
    assert fill("<b>{}</b>{x}", "<i>", x=Html("<i>")) == "<b>&lt;i&gt;</b><i>"
    assert fill('<a title="{}">', "\"'&") == '<a title="&quot;&#x27;&amp;">'
    assert fill("{:.1f} {}", 1.25, None) == "1.2 None"
    assert joined(["<", Html("<p>")]) == "&lt;<p>"
    assert isinstance(fill(""), Html) and isinstance(joined([]), Html)


def test_a_value_is_no_template() -> None:
    assert fill("{}", "{0.__class__}{x}") == "{0.__class__}{x}"


def test_what_changes_html_makes_text_of_it() -> None:
    """``Html`` that was cut, joined or put into another text is escaped again."""
    assert fill("{}", Html("<p>") + "<script>") == "&lt;p&gt;&lt;script&gt;"
    assert fill("{}", f"{Html('<p>')}") == "&lt;p&gt;"
    with pytest.raises(ValueError, match="conversion"):
        fill("{!s}", Html("<p>"))


def test_page_puts_values_into_html_by_fill_only() -> None:
    tree = ast.parse(PAGE.read_text(encoding="utf-8"))
    mixed = [
        node.lineno
        for node in ast.walk(tree)
        if isinstance(node, ast.JoinedStr)
        and any(isinstance(part, ast.Constant) and "<" in str(part.value) for part in node.values)
    ]
    assert mixed == [], "an f-string does not escape its values: use `fill`"
    trusted = [
        ast.unparse(node.args[0])
        for node in ast.walk(tree)
        if isinstance(node, ast.Call) and ast.unparse(node.func) == "Html" and node.args
        and not isinstance(node.args[0], ast.Constant)
    ]  # fmt: skip
    # Constants of the program, and a drawing of numbers.
    assert set(trusted) == {"STYLE", "curve"}
