"""The table of the benchmark."""

from __future__ import annotations

from collections.abc import Sequence

from .running import Outcome

__all__ = ["table"]


def table(outcomes: Sequence[Outcome]) -> str:
    """Return the table in Markdown, with a line of totals for each half above it."""
    lines = []
    for choosing, name in ((True, "Choosing half (in sample)"), (False, "Telling half (test)")):
        half = [one for one in outcomes if one.choosing == choosing]
        sound, spoilt = [one for one in half if not one.causes], [one for one in half if one.causes]
        quiet = sum(one.colour == "green" for one in sound)
        named = sum(one.is_named for one in spoilt)
        noticed = sum(one.colour != "green" or one.is_named for one in spoilt)
        lines.append(
            f"- {name}: {quiet} of {len(sound)} sound sets are green; of {len(spoilt)} spoilt sets {named} are named "
            f"or mended, and {noticed} are noticed."
        )
    lines += [
        "",
        "| photos | half | placed | error, px | positions | found | as it should be |",
        "|---|---|---|---|---|---|---|",
    ]
    for one in outcomes:
        good = one.is_named if one.causes else one.colour == "green"
        lines.append(
            f"| {one.name} | {'choosing' if one.choosing else 'test'} | {one.n_placed} of {one.n_photos} "
            f"| {'' if one.error is None else f'{one.error:.2f}'} "
            f"| {'' if one.position_error is None else f'{one.position_error:.1%}'} "
            f"| {one.colour} {one.cause.replace('_', ' ')} | {'yes' if good else 'no'} |"
        )
    return "\n".join(lines)
