"""Options under their old names: they work for one more release, with a warning."""

from __future__ import annotations

import argparse

import pytest

from engine.cli.commands.deprecated import add_deprecated_option, warn_of_deprecated_options
from engine.cli.main import build_parser
from engine.core.events import Event, Warned


def parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser()
    add_deprecated_option(parser, "--passers-by", replaced_by=parser.add_argument("--transients", action="store_true"))
    group = parser.add_mutually_exclusive_group()
    group.add_argument("--text")
    seeds = group.add_argument("--random-seed", type=int, default=7)
    add_deprecated_option(group, "--seed", replaced_by=seeds)
    return parser


def warnings_of(options: argparse.Namespace) -> list[str]:
    events: list[Event] = []
    warn_of_deprecated_options(options, events.append)
    return [event.message for event in events if isinstance(event, Warned)]


def test_old_option_stores_the_value_of_the_new_one_and_warns() -> None:
    options = parser().parse_args(["--passers-by", "--seed", "3"])
    assert options.transients is True
    assert options.random_seed == 3
    assert warnings_of(options) == [
        "--passers-by is deprecated and will be removed in the next release. Use --transients instead.",
        "--seed is deprecated and will be removed in the next release. Use --random-seed instead.",
    ]


def test_new_option_and_defaults_warn_of_nothing() -> None:
    options = parser().parse_args(["--transients"])
    assert options.transients is True and options.random_seed == 7
    assert warnings_of(options) == []
    assert parser().parse_args([]).transients is False


def test_old_option_is_missing_in_the_help_and_bound_by_its_group(capsys: pytest.CaptureFixture[str]) -> None:
    assert "--passers-by" not in parser().format_help()
    with pytest.raises(SystemExit):
        parser().parse_args(["--text", "vase", "--seed", "3"])
    assert "not allowed with" in capsys.readouterr().err


def test_options_of_the_first_release_still_work() -> None:
    options = build_parser().parse_args(["bench", "photos", "--seeds", "0,1"])
    assert options.random_seeds == "0,1" and "--random-seeds" in warnings_of(options)[0]
    options = build_parser().parse_args(["reconstruct", "photos", "--out", "scene", "--passers-by"])
    assert options.transients is True and "--transients" in warnings_of(options)[0]
