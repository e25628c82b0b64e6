"""An error in any function that Blender calls becomes one sentence. The functions are those that are registered."""

from __future__ import annotations

import importlib
import inspect
from collections.abc import Callable, Iterator
from contextlib import ExitStack
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import bpy
import pytest
from conftest import FakeLayout, Part

ERRORS = [RuntimeError("a"), MemoryError(), KeyError("b"), UnicodeDecodeError("utf-8", b"\xff", 0, 1, "c")]
"""Operators fail with each of them. One is enough for the other guards, which make their sentences in the same way."""


def registered_classes(part: Part) -> list[type]:
    """Return every class of the extension that Blender knows."""
    found: set[type] = set()
    package = part("operators").__name__.rpartition(".")[0]
    kinds = ("Operator", "Panel", "Menu", "UIList", "FileHandler", "AddonPreferences", "PropertyGroup")
    waiting = [getattr(bpy.types, kind) for kind in kinds]
    while waiting:
        for cls in waiting.pop().__subclasses__():
            waiting.append(cls)
            if cls.__module__.startswith(package) and cls.is_registered:
                found.add(cls)
    return sorted(found, key=lambda cls: cls.__name__)


def called_functions(cls: type) -> list[tuple[str, Any]]:
    """Return the functions of a class that Blender calls, by Blender's own list."""
    names = [function.identifier for function in cls.bl_rna.functions if function.is_registered]
    functions = [(name, inspect.getattr_static(cls, name, None)) for name in names]
    return [(name, getattr(f, "__func__", f)) for name, f in functions if inspect.isfunction(getattr(f, "__func__", f))]


@pytest.fixture
def log(part: Part, tmp_path: Path) -> Iterator[Path]:
    """Log unexpected errors to a temporary file, and start without a problem in the panel."""
    problems = part("gaussian_heritage_addon.blender.problems")
    earlier = problems._log_folder
    problems.set_log_folder(lambda: tmp_path)
    problems.clear()
    yield tmp_path / "errors.log"
    problems.set_log_folder(earlier)
    problems.clear()


def failing(monkeypatch: pytest.MonkeyPatch, guarded: Any, error: BaseException) -> None:
    """Make the function behind a guard raise `error`."""

    def fail(*_: Any) -> None:
        raise error

    monkeypatch.setitem(vars(guarded), "__wrapped__", fail)


def is_sentence(text: str, error: Exception, log: Path) -> bool:
    return type(error).__name__ in text and str(log) in text and "\n" not in text and "Traceback" not in text


def test_every_function_that_blender_calls_has_a_guard(part: Part) -> None:
    classes = registered_classes(part)
    expected = {"Operator": 16, "Panel": 3, "UIList": 1, "FileHandler": 1, "AddonPreferences": 1, "PropertyGroup": 3}
    for kind, count in expected.items():
        assert sum(issubclass(cls, getattr(bpy.types, kind)) for cls in classes) >= count, kind
    for cls in classes:
        for name, function in called_functions(cls):
            assert vars(function).get("is_guard"), f"{cls.__name__}.{name}"
        for prop, name, callback in part("gaussian_heritage_addon.blender.guards").property_callbacks(cls):
            assert vars(callback).get("is_guard"), f"{cls.__name__}: {name} of {prop.keywords.get('name')}"


def test_guards_keep_what_blender_and_users_read(part: Part) -> None:
    for cls in registered_classes(part):
        if issubclass(cls, bpy.types.Operator):
            operator = getattr(bpy.ops.heritage, cls.bl_idname.partition(".")[2]).get_rna_type()
            assert operator.description == (inspect.getdoc(cls) or "").strip()
            assert cls.execute.__name__ == "execute" and cls.execute.__doc__


@pytest.mark.parametrize("error", ERRORS, ids=lambda error: type(error).__name__)
def test_operator_that_fails_reports_a_sentence(
    part: Part,
    log: Path,
    error: Exception,
    project: Any,
    monkeypatch: pytest.MonkeyPatch,
    capfd: pytest.CaptureFixture[str],
) -> None:
    bpy.context.scene.heritage.project = str(project.folder)
    operators = [cls for cls in registered_classes(part) if issubclass(cls, bpy.types.Operator)]
    for cls in operators:
        failing(monkeypatch, vars(cls)["execute"], error)
        with pytest.raises(RuntimeError) as caught:
            getattr(bpy.ops.heritage, cls.bl_idname.partition(".")[2])("EXEC_DEFAULT")
        text = str(caught.value).strip().removeprefix("Error: ")
        assert is_sentence(text, error, log), (cls, text)
    printed = capfd.readouterr()
    assert "Traceback" not in printed.out + printed.err
    assert "Traceback (most recent call last)" in log.read_text(encoding="utf-8")


def test_function_that_fails_returns_what_blender_needs(
    part: Part, log: Path, monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture[str]
) -> None:
    error = UnicodeDecodeError("utf-8", b"\xff", 0, 1, "c")
    problems = part("gaussian_heritage_addon.blender.problems")
    seen = set()
    for cls in registered_classes(part):
        for name, function in called_functions(cls):
            failing(monkeypatch, function, error)
            reports: list[str] = []
            layout = FakeLayout()
            owner = SimpleNamespace(report=lambda kind, text, reports=reports: reports.append(text), layout=layout)
            problems.clear()
            count = function.__code__.co_argcount
            arguments = [bpy.context, layout, *[None] * 20][: count - 1]
            result = function(cls if isinstance(inspect.getattr_static(cls, name), classmethod) else owner, *arguments)
            expected = {"execute": {"CANCELLED"}, "invoke": {"CANCELLED"}, "modal": {"CANCELLED"}}
            expected |= {"poll": False, "poll_drop": False, "check": False, "filter_items": ([], []), "description": ""}
            assert result == expected.get(name), (cls, name)
            told = reports + [" ".join(layout.texts)] * bool(layout.texts) + [problems.shown()] * bool(problems.shown())
            assert len(told) == 1 and type(error).__name__ in told[0], (cls, name, told)
            seen.add(name)
    assert seen >= {"execute", "invoke", "modal", "draw", "cancel", "poll", "draw_item", "filter_items", "poll_drop"}
    assert "Traceback" not in "".join(capfd.readouterr())


def callbacks(part: Part) -> list[tuple[type, str, Any, str, Any]]:
    """Return the callbacks of all properties: class, name of the property, property, name and function."""
    found = []
    for cls in registered_classes(part):
        names = {id(prop): name for base in cls.__mro__ for name, prop in vars(base).get("__annotations__", {}).items()}
        for prop, name, function in part("gaussian_heritage_addon.blender.guards").property_callbacks(cls):
            found.append((cls, names[id(prop)], prop, name, function))
    return found


def test_property_whose_callback_fails_leaves_a_sentence_for_the_panel(
    project: Any,
    part: Part,
    log: Path,
    monkeypatch: pytest.MonkeyPatch,
    capfd: pytest.CaptureFixture[str],
) -> None:
    error = RuntimeError("a")
    bpy.ops.heritage.open_project(directory=str(project.folder))
    problems, vase = part("gaussian_heritage_addon.blender.problems"), bpy.data.objects["Vase"]
    owners = {"HeritageScene": bpy.context.scene.heritage, "HeritageObject": vase.heritage}
    values = {"StringProperty": "x", "FloatProperty": 0.25, "IntProperty": 3, "BoolProperty": True}
    every = callbacks(part)
    assert len(every) >= 11
    for cls, name, prop, callback, function in every:
        failing(monkeypatch, function, error)
        vase.heritage.problem = ""
        problems.clear()
        owner = owners.get(cls.__name__)
        if owner is None or callback not in ("update", "get", "set"):
            result = function(SimpleNamespace(bl_rna=cls.bl_rna), *[None] * (function.__code__.co_argcount - 1))
            assert result == ([] if callback in ("items", "search") else None), (cls, name, callback)
        elif callback == "get":
            assert getattr(owner, name) == ("" if prop.function.__name__ == "StringProperty" else 0.0)
        elif prop.function.__name__ == "EnumProperty":
            setattr(owner, name, owner.bl_rna.properties[name].enum_items[-1].identifier)
        else:
            setattr(owner, name, values[prop.function.__name__])
        assert is_sentence(problems.shown() or vase.heritage.problem, error, log), (cls, name, callback)
        monkeypatch.undo()
    assert "Traceback" not in "".join(capfd.readouterr())


def test_timer_that_fails_ends_and_the_panel_says_why(
    part: Part,
    log: Path,
    draw: Callable[[str], FakeLayout],
    monkeypatch: pytest.MonkeyPatch,
    capfd: pytest.CaptureFixture[str],
) -> None:
    error = KeyError("b")
    timers = part("gaussian_heritage_addon.blender.guards").TIMERS
    assert len(timers) >= 2
    for timer in timers:
        failing(monkeypatch, timer._call, error)
        part("gaussian_heritage_addon.blender.problems").clear()
        assert timer() is None
        assert type(error).__name__ in " ".join(draw("HERITAGE_PT_progress").texts)
    assert "Traceback" not in "".join(capfd.readouterr())


def test_menu_entry_that_fails_draws_a_sentence(part: Part, log: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    entries = [
        entry
        for menu in (bpy.types.TOPBAR_MT_file_import, bpy.types.TOPBAR_MT_file_export)
        for entry in menu.draw._draw_funcs
        if entry.__module__.startswith(part("operators").__name__)
    ]
    assert len(entries) == 2
    for entry in entries:
        failing(monkeypatch, entry, KeyError("x"))
        layout = FakeLayout()
        entry(SimpleNamespace(layout=layout), bpy.context)
        # Drawn in lines, which break long paths, also at the spaces that they contain.
        drawn, path = ("".join(text.split()) for text in ("".join(layout.texts), str(log)))
        assert "KeyError" in layout.texts[0] and path in drawn


def test_draw_handler_that_fails_is_called_once(part: Part, log: Path) -> None:
    guards, calls, handlers = part("gaussian_heritage_addon.blender.guards"), [], []
    space = SimpleNamespace(draw_handler_add=lambda function, *_: handlers.append(function))

    def draw() -> None:
        calls.append(1)
        raise KeyError("x")

    guards.add_draw_handler(space, draw)
    for _ in range(60):
        handlers[0]()
    assert len(calls) == 1 and "KeyError" in part("gaussian_heritage_addon.blender.problems").shown()
    assert log.read_text(encoding="utf-8").count("Traceback") == 1


def test_draw_handler_that_fails_says_so_once(part: Part, log: Path) -> None:
    handlers: list[Callable[[], None]] = []
    failures: list[int] = []
    space = SimpleNamespace(draw_handler_add=lambda function, *_: handlers.append(function))
    draw = {}.__getitem__
    part("gaussian_heritage_addon.blender.guards").add_draw_handler(
        space, lambda: draw("x"), "POST_VIEW", failed=lambda: failures.append(1)
    )
    for _ in range(3):
        handlers[0]()
    assert failures == [1]


def test_changed_meshes_are_told_and_errors_are_shown(part: Part, log: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    guards, told = part("gaussian_heritage_addon.blender.guards"), []
    monkeypatch.setattr(guards, "_REGISTERED", ExitStack())

    def changed(data: list[bpy.types.ID]) -> None:
        told.extend(data)
        if len(told) > 100:
            raise KeyError("x")

    mesh = bpy.data.meshes.new("mesh")
    bpy.context.scene.collection.objects.link(bpy.data.objects.new("obj", mesh))
    bpy.context.view_layer.update()
    guards.add_change_handler(changed)
    try:
        mesh.vertices.add(3)
        mesh.update_tag()
        bpy.context.view_layer.update()
        assert mesh in told
        told.extend([mesh] * 100)
        mesh.update_tag()
        bpy.context.view_layer.update()
        assert "KeyError" in part("gaussian_heritage_addon.blender.problems").shown()
    finally:
        guards._REGISTERED.close()
    count = len(told)
    mesh.update_tag()
    bpy.context.view_layer.update()
    assert len(told) == count


def test_modal_operator_that_fails_removes_its_draw_handler(part: Part, log: Path) -> None:
    cls, ended = part("operators.click_object").HERITAGE_OT_click_object, []
    reports: list[str] = []

    class Operator:
        modal = cls.modal
        report = staticmethod(lambda kind, text: reports.append(text))

        def cancel(self, context: Any) -> None:
            ended.append(context)

    assert Operator().modal(bpy.context, None) == {"CANCELLED"}
    assert ended == [bpy.context] and "AttributeError" in reports[0]


def test_keyboard_interrupt_passes(part: Part, monkeypatch: pytest.MonkeyPatch) -> None:
    for passing in (KeyboardInterrupt(), SystemExit()):
        panel = bpy.types.HERITAGE_PT_scene
        failing(monkeypatch, vars(panel)["draw"], passing)
        with pytest.raises(type(passing)):
            panel.draw(SimpleNamespace(layout=FakeLayout()), bpy.context)


def test_log_of_unexpected_errors_is_in_the_users_folder(part: Part, installed: str) -> None:
    problems, preferences = (
        part("gaussian_heritage_addon.blender.problems"),
        part("gaussian_heritage_addon.setup.preferences"),
    )
    sentence = problems.sentence_of(KeyError("x"))
    assert str(preferences.user_folder("log") / "errors.log") in sentence
    root = Path(importlib.import_module(installed).__path__[0])
    assert not preferences.user_folder("log").is_relative_to(root)
