"""The table of the benchmark."""

from __future__ import annotations

from collections.abc import Sequence

from .running import Outcome

_KINDS = {
    "sound": "sound",
    "zoom": "wrong zoom",
    "swapped": "files swapped, wrong given cameras",
    "mirrored": "mirrored",
    "duplicated": "duplicated wall",
    "other": "spoilt in other ways",
}
_FOUR = ("zoom", "swapped", "mirrored", "duplicated")
"""The kinds of spoilt sets that are counted together."""


def table(outcomes: Sequence[Outcome]) -> str:
    """Return two tables in Markdown: how many sets of each kind are as they should be, and all sets."""
    lines = [
        "| kind | choosing, generated | choosing, real | test, generated | test, real |",
        "|---|---|---|---|---|",
    ]
    for kind, name in _KINDS.items():
        lines.append(_counts(name, [one for one in outcomes if one.kind == kind]))
        if kind == _FOUR[-1]:
            lines.append(_counts("the four kinds together", [one for one in outcomes if one.kind in _FOUR]))
    lines += [
        "",
        "| photos | half | placed | error, px | positions | found | as it should be |",
        "|---|---|---|---|---|---|---|",
    ]
    for one in outcomes:
        lines.append(
            f"| {one.name} | {'choosing' if one.choosing else 'test'} | {one.n_placed} of {one.n_photos} "
            f"| {'' if one.error is None else f'{one.error:.2f}'} "
            f"| {'' if one.position_error is None else f'{one.position_error:.1%}'} "
            f"| {one.colour} {one.cause.replace('_', ' ')} "
            f"| {'yes' if one.is_as_it_should_be else 'no'}: {one.verdict} |"
        )
    return "\n".join(lines)


def _counts(name: str, outcomes: Sequence[Outcome]) -> str:
    cells = []
    for choosing in (True, False):
        for is_real in (False, True):
            found = [one for one in outcomes if (one.choosing, one.is_real) == (choosing, is_real)]
            good = sum(one.is_as_it_should_be for one in found)
            cells.append(f"{good} of {len(found)}" if found else "")
    return f"| {name} | {' | '.join(cells)} |"
