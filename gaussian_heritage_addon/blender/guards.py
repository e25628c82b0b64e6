"""The only way by which Blender calls our code: no error leaves as a traceback.

Every class, timer, menu entry, handler and subscription of the add-on is registered here. Functions that Blender calls
are wrapped: an error becomes a sentence, which an operator reports, a panel draws, and a timer or callback leaves for
the panel, see `problems`. ``tests/addon/test_guards.py`` checks that no other module registers anything.
"""

from __future__ import annotations

import contextlib
import functools
import inspect
from collections.abc import Callable
from typing import Any

import bpy

from . import problems
from .drawn_text import draw_text

Function = Callable[..., Any]
Failed = Callable[..., Any]
"""Called with the sentence and the arguments of the function that failed; returns what Blender gets instead."""


def register_class(cls: type) -> None:
    """Register `cls` with Blender, with a guard around each of its functions that Blender calls."""
    results = next(results for kind, results in _FAILED.items() if issubclass(cls, kind))
    for function in cls.bl_rna.functions:  # type: ignore[attr-defined]
        if function.is_registered:
            _guard_method(cls, function.identifier, results.get(function.identifier, _shown))
    for owner, name, callback in property_callbacks(cls):
        owner.keywords[name] = _guarded(callback, _callback_failed(owner, name))
    bpy.utils.register_class(cls)
    on_unregister(bpy.utils.unregister_class, cls)


def add_property(owner: type, name: str, kind: type) -> None:
    """Add a property group to the data of a type, such as scenes; its class `kind` must be registered already."""
    setattr(owner, name, bpy.props.PointerProperty(type=kind))
    on_unregister(delattr, owner, name)


def on_unregister(function: Function, *arguments: Any) -> None:
    """Call `function` when the add-on is taken from Blender, before what was registered earlier is undone."""
    _REGISTERED.callback(function, *arguments)


def unregister() -> None:
    """Take all that was registered from Blender, last first, after the timers were stopped."""
    for timer in TIMERS:
        timer.stop()
    _REGISTERED.close()


_REGISTERED = contextlib.ExitStack()


def property_callbacks(cls: type) -> list[tuple[Any, str, Function]]:
    """Return the functions that Blender calls for properties of `cls`: property, name of its argument, function."""
    declared = [prop for base in cls.__mro__ for prop in vars(base).get("__annotations__", {}).values()]
    return [
        (prop, name, value)
        for prop in declared
        for name, value in getattr(prop, "keywords", {}).items()
        if inspect.isfunction(value)
    ]


def redraw() -> None:
    """Draw again what shows the state of a job: sidebars, preferences, file browsers. The scene may take minutes."""
    for window in bpy.context.window_manager.windows:
        for area in window.screen.areas:
            if area.type in ("PREFERENCES", "FILE_BROWSER"):
                area.tag_redraw()
            elif area.type == "VIEW_3D":
                for region in area.regions:
                    if region.type == "UI":
                        region.tag_redraw()


def _guard_method(cls: type, name: str, failed: Failed) -> None:
    found = inspect.getattr_static(cls, name, None)
    function = found.__func__ if isinstance(found, classmethod) else found
    if inspect.isfunction(function):
        begins = issubclass(cls, bpy.types.Operator) and name in ("execute", "invoke")
        guarded = _guarded(function, failed, before=problems.clear if begins else None)
        setattr(cls, name, classmethod(guarded) if isinstance(found, classmethod) else guarded)


def _guarded(function: Function, failed: Failed, *, before: Callable[[], None] | None = None) -> Function:
    """Return `function`, with the same number of arguments, which Blender checks, and `failed` in place of errors."""
    if vars(function).get(_MARK):
        return function

    def call(*arguments: Any) -> Any:
        if before is not None:
            before()
        # Looked up at each call, so that tests can replace it by a function that raises.
        inner: Function = vars(guarded)["__wrapped__"]
        try:
            return inner(*arguments)
        except Exception as error:
            return failed(problems.sentence_of(error), *arguments)

    guarded = functools.wraps(function)(_with_arguments(call, function.__code__.co_argcount))
    vars(guarded)[_MARK] = True
    return guarded


_MARK = "is_guard"


def _with_arguments(call: Function, count: int) -> Function:
    """Return `call` as a function of exactly `count` arguments."""
    functions: dict[int, Function] = {
        0: lambda: call(),
        1: lambda a: call(a),
        2: lambda a, b: call(a, b),
        3: lambda a, b, c: call(a, b, c),
        4: lambda a, b, c, d: call(a, b, c, d),
        # UIList.draw_item, whose last two arguments Blender may leave out.
        10: lambda a, b, c, d, e, f, g, h, i=0, j=0: call(a, b, c, d, e, f, g, h, i, j),
    }
    return functions[count]


# ---- what Blender gets from a function that failed


def _reported(sentence: str, operator: Any, *_: Any) -> set[str]:
    operator.report({"ERROR"}, sentence)
    return {"CANCELLED"}


def _reported_and_ended(sentence: str, operator: Any, context: bpy.types.Context, *_: Any) -> set[str]:
    """End an operator that may have begun to handle events: without `cancel` it would leave its draw handler."""
    cancel = getattr(operator, "cancel", None)
    if inspect.ismethod(cancel):
        cancel(context)
    return _reported(sentence, operator)


def _refused(sentence: str, cls: Any, *_: Any) -> bool:
    with contextlib.suppress(AttributeError):  # only operators have it
        cls.poll_message_set(sentence)
    problems.show(sentence)
    return False


def _drawn(sentence: str, drawing: Any, *_: Any) -> None:
    _draw(drawing.layout, sentence)


def _row_drawn(sentence: str, drawing: Any, context: bpy.types.Context, layout: bpy.types.UILayout, *_: Any) -> None:
    _draw(layout, sentence)


def _draw(layout: bpy.types.UILayout, sentence: str) -> None:
    # Where even this cannot be drawn, the log file has the error.
    with contextlib.suppress(Exception):
        draw_text(layout, sentence, icon="ERROR")


def _unfiltered(sentence: str, *_: Any) -> tuple[list[int], list[int]]:
    problems.show(sentence)
    return [], []


def _shown(sentence: str, *_: Any) -> None:
    problems.show(sentence)


def _no_text(sentence: str, *_: Any) -> str:
    problems.show(sentence)
    return ""


_FAILED: dict[type, dict[str, Failed]] = {
    bpy.types.Operator: {
        "execute": _reported,
        "invoke": _reported_and_ended,
        "modal": _reported_and_ended,
        "draw": _drawn,
        "poll": _refused,
        "check": _refused,
        "description": _no_text,
    },
    bpy.types.Panel: {"draw": _drawn, "draw_header": _drawn, "draw_header_preset": _drawn, "poll": _refused},
    bpy.types.Menu: {"draw": _drawn, "poll": _refused},
    bpy.types.UIList: {"draw_item": _row_drawn, "draw_filter": _row_drawn, "filter_items": _unfiltered},
    bpy.types.FileHandler: {"poll_drop": _refused},
    bpy.types.AddonPreferences: {"draw": _drawn},
    bpy.types.PropertyGroup: {},
}
"""By the kind of class: the functions of which Blender needs a result, or which can show the sentence themselves."""


def _callback_failed(prop: Any, name: str) -> Failed:
    """Return what happens when the callback `name` of a property fails."""
    defaults = {"BoolProperty": False, "IntProperty": 0, "FloatProperty": 0.0, "StringProperty": ""}
    value = {
        "get": prop.keywords.get("default", defaults.get(prop.function.__name__)),
        "items": [],
        "search": [],
        "poll": False,
    }.get(name)

    def failed(sentence: str, owner: Any, *_: Any) -> Any:
        if "problem" in owner.bl_rna.properties:
            owner.problem = sentence
        else:
            problems.show(sentence)
        return value

    return failed


# ---- timers, menus and draw handlers

TIMERS: list[Timer] = []
"""All timers of the add-on."""


class Timer:
    """A function that Blender calls later, and again after as many seconds as it returns.

    It ends when it fails; the sentence is shown in the panel.
    """

    def __init__(self, function: Callable[[], float | None]) -> None:
        self._call = _guarded(function, self._failed)
        TIMERS.append(self)

    def __call__(self) -> float | None:
        """Call the function once."""
        seconds: float | None = self._call()
        return seconds

    def start(self, first_interval: float, *, persistent: bool = False) -> None:
        """Call the function after `first_interval` seconds, unless it waits already."""
        if not bpy.app.timers.is_registered(self._call):
            bpy.app.timers.register(self._call, first_interval=first_interval, persistent=persistent)

    def stop(self) -> None:
        """Do not call the function any more."""
        if bpy.app.timers.is_registered(self._call):
            bpy.app.timers.unregister(self._call)

    @staticmethod
    def _failed(sentence: str, *_: Any) -> None:
        problems.show(sentence)
        with contextlib.suppress(Exception):
            redraw()


def add_menu_entry(menu: type, draw: Function) -> None:
    """Add `draw` to the end of a menu of Blender."""
    entry = _guarded(draw, _drawn)
    menu.append(entry)  # type: ignore[attr-defined]
    on_unregister(menu.remove, entry)  # type: ignore[attr-defined]


def add_load_handler(function: Callable[[], None]) -> None:
    """Call `function` after each .blend file that Blender loads."""
    _add_handler(function, _nothing, bpy.app.handlers.load_post)


def add_undo_handler(function: Callable[[], None]) -> None:
    """Call `function` after each step that Blender undoes or does again."""
    _add_handler(function, _nothing, bpy.app.handlers.undo_post, bpy.app.handlers.redo_post)


def add_update_handler(function: Callable[[], None]) -> None:
    """Call `function` after each change of any kind, such as of the selection, and after undo."""
    _add_handler(function, _nothing, bpy.app.handlers.depsgraph_update_post)


def add_change_handler(function: Callable[[list[bpy.types.ID]], None]) -> None:
    """Call `function` with the data whose geometry changed, after each change that Blender has evaluated, and undo."""

    def changed(_: Any, depsgraph: bpy.types.Depsgraph) -> tuple[list[bpy.types.ID]]:
        return ([one.id.original for one in depsgraph.updates if one.is_updated_geometry],)

    _add_handler(function, changed, bpy.app.handlers.depsgraph_update_post, failed=_shown)


def add_datablock_handler(function: Callable[[list[bpy.types.ID]], None]) -> None:
    """Call `function` with all data that changed in any way, such as in name, as `add_change_handler` does."""

    def changed(_: Any, depsgraph: bpy.types.Depsgraph) -> tuple[list[bpy.types.ID]]:
        return ([one.id.original for one in depsgraph.updates],)

    _add_handler(function, changed, bpy.app.handlers.depsgraph_update_post, failed=_shown)


def add_save_handlers(before: Callable[[str], None], after: Callable[[str], None]) -> None:
    """Call `before` and `after` with the path of each .blend file that Blender writes, also where it fails."""

    def path(file: str, *_: Any) -> tuple[str]:
        return (file,)

    _add_handler(before, path, bpy.app.handlers.save_pre)
    _add_handler(after, path, bpy.app.handlers.save_post, bpy.app.handlers.save_post_fail)


def add_import_handler(function: Callable[[list[tuple[bpy.types.ID, str]]], None]) -> None:
    """Call `function` with the data that was appended or linked, and the path of the .blend file of each."""

    def imported(context: Any, *_: Any) -> tuple[list[tuple[bpy.types.ID, str]]]:
        items = [(item.id, item.source_library) for item in context.import_items]
        return ([(one, library.filepath) for one, library in items if one is not None and library is not None],)

    _add_handler(function, imported, bpy.app.handlers.blend_import_post)


def _nothing(*_: Any) -> tuple[()]:
    return ()


def _add_handler(
    function: Callable[..., None],
    arguments: Callable[..., tuple[Any, ...]],
    *events: list[Function],
    failed: Failed = Timer._failed,
) -> None:
    """Call `function` after `events`, with the `arguments` that follow from those that Blender gives."""

    def after_event(*given: Any) -> None:
        guarded(*arguments(*given))

    guarded = _guarded(function, failed)
    handler = bpy.app.handlers.persistent(after_event)
    for event in events:
        event.append(handler)
        on_unregister(event.remove, handler)


def subscribe(key: Any, function: Callable[[], None]) -> None:
    """Call `function` after each change of a property, once for all subscriptions to it; see ``bpy.msgbus``."""
    bpy.msgbus.clear_by_owner(function)
    bpy.msgbus.subscribe_rna(key=key, owner=function, args=(), notify=_guarded(function, Timer._failed))
    on_unregister(bpy.msgbus.clear_by_owner, function)


def add_draw_handler(
    space: type, draw: Callable[[], None], when: str = "POST_PIXEL", *, failed: Callable[[], None] | None = None
) -> Any:
    """Call `draw` whenever Blender has drawn a region of the type of editor `space`, and return a handle.

    After an error it is not called again: a viewport is drawn up to 60 times a second.

    Parameters
    ----------
    when : str
        ``"POST_PIXEL"``, in pixels of the region, or ``"POST_VIEW"``, before what Blender draws over the scene.
    failed : callable, optional
        Called after an error.
    """
    works = True

    def draw_until_it_fails() -> None:
        nonlocal works
        if works:
            try:
                draw()
            except Exception as error:
                works = False
                problems.show(problems.sentence_of(error))
                if failed is not None:
                    failed()

    return space.draw_handler_add(draw_until_it_fails, (), "WINDOW", when)  # type: ignore[attr-defined]


def remove_draw_handler(space: type, handle: Any) -> None:
    """Undo `add_draw_handler`."""
    space.draw_handler_remove(handle, "WINDOW")  # type: ignore[attr-defined]
