"""``reconstruct --set`` trains with one other setting; the scene of other settings is trained again."""

from __future__ import annotations

from .conftest import Computer


def test_a_setting_of_the_command_line_is_trained_with_recorded_and_part_of_the_key(
    computer: Computer,
) -> None:
    first = ("--until", "training", "--set", "steps=7", "--set", "lr_means=2e-3")
    computer.run(*first)
    stored = computer.stored()
    training = stored["stages"]["training"]
    assert training["figures"]["steps"] == 7
    assert (training["run"]["settings"]["steps"], training["run"]["settings"]["lr_means"]) == (7, 2e-3)
    assert stored["work_plan"]["overrides"] == {"steps": 7, "lr_means": 2e-3}

    assert computer.run(*first).computed == []
    assert computer.run("--until", "training").computed == ["training"]
    assert computer.stored()["stages"]["training"]["figures"]["steps"] != 7


def test_an_unknown_setting_is_refused_with_the_names_before_any_work(computer: Computer) -> None:
    error = computer.run("--set", "lr_mean=1").error
    assert "no setting `lr_mean`" in error and "lr_means_end" in error
    assert not (computer.scene / "project.json").exists()
