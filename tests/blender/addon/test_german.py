"""Whatever Blender shows of the add-on's operators, panels and properties has a German text."""

from __future__ import annotations

from collections.abc import Iterator
from types import ModuleType, SimpleNamespace
from typing import Any

import bpy
import pytest
from conftest import Part, german_texts

_TYPES = (
    bpy.types.Operator,
    bpy.types.Panel,
    bpy.types.PropertyGroup,
    bpy.types.AddonPreferences,
    bpy.types.FileHandler,
)


def own_classes() -> list[type]:
    """Return the classes that the add-on has registered."""
    found = [
        cls
        for kind in _TYPES
        for cls in kind.__subclasses__() + [one for sub in kind.__subclasses__() for one in sub.__subclasses__()]
        if ".gaussian_heritage." in f"{cls.__module__}." and getattr(cls, "is_registered", False)
    ]
    return list(dict.fromkeys(found))


def shown_texts(cls: Any) -> Iterator[str]:
    """Yield what Blender shows of a class: labels, tooltips, and those of its properties and their choices."""
    rna = cls.bl_rna
    if hasattr(cls, "bl_label"):
        yield cls.bl_label
    if issubclass(cls, bpy.types.Operator):
        rna = getattr(bpy.ops.heritage, cls.bl_idname.partition(".")[2]).get_rna_type()
        yield rna.description
    base = dict(rna.base.properties.items()) if rna.base else {}
    for name, prop in rna.properties.items():
        if name in base or prop.is_hidden:
            continue
        # A property without a name is none that is drawn.
        if prop.name != name:
            yield prop.name
        yield prop.description
        for item in getattr(prop, "enum_items_static", None) or ():
            # Names of models and files have no description and are the same in every language.
            if item.description:
                yield from (item.name, item.description)


def test_every_label_and_tooltip_has_a_german_text(blender: ModuleType, part: Part) -> None:
    german = dict(german_texts(part))
    classes = own_classes()
    assert len(classes) > 40
    # Blender's own, of its base class of exporters.
    german |= {"File Path": "", "Filepath used for exporting the file": ""}
    missing = {text: cls.__name__ for cls in classes for text in shown_texts(cls) if text and text not in german}
    assert missing == {}


def test_german_is_given_to_blender_for_labels_and_operators(part: Part, monkeypatch: pytest.MonkeyPatch) -> None:
    translations, given = part("gaussian_heritage_addon.language.translations"), {}
    # Blender as a Python module has no translations; the window test looks at a German window.
    fake = SimpleNamespace(register=lambda name, texts: given.update(texts))
    monkeypatch.setattr(translations, "bpy", SimpleNamespace(app=SimpleNamespace(translations=fake)))
    translations.register()
    assert set(given) == {"de", "de_DE"}
    for context in ("*", "Operator"):
        assert given["de"][context, "Ground"] == "Boden"
        assert given["de"][context, "Do not start this job"] == "Diese Arbeit nicht beginnen"


def test_panel_says_in_german_why_no_card_trains(part: Part, monkeypatch: pytest.MonkeyPatch) -> None:
    job_box, german = part("gaussian_heritage_addon.panels.job_box"), german_texts(part)
    monkeypatch.setattr(job_box, "translated", lambda text, *values: german.get(text, text).format(*values))
    assert job_box.device_text("Card (Vulkan)", "") == "Rechnet auf: Card (Vulkan)"
    reason = part("engine.rasterizer.devices")._NO_CARD_SENTENCE
    assert job_box.device_text("cpu", reason).startswith("Rechnet auf: Prozessor (Grund: dieser Computer hat keine")


def test_texts_with_values_are_translated_before_the_values_are_filled_in(
    part: Part, monkeypatch: pytest.MonkeyPatch
) -> None:
    translations, german = part("gaussian_heritage_addon.language.translations"), german_texts(part)
    fake = SimpleNamespace(pgettext_iface=lambda text: german.get(text, text))
    monkeypatch.setattr(translations, "bpy", SimpleNamespace(app=SimpleNamespace(translations=fake)))
    assert translations.translated("Part to Whole: {} of {}", 2, 3) == "Teil bis Ganzes: 2 von 3"
    # A name of the user is shown as it is.
    assert translations.translated("Vase {blue}") == "Vase {blue}"


@pytest.mark.parametrize(
    ("locale", "is_wanted", "code"), [("de_DE", True, "de"), ("de_DE", False, "en"), ("ja_JP", True, "en")]
)
def test_report_and_sentences_are_in_the_language_of_the_interface(
    part: Part, monkeypatch: pytest.MonkeyPatch, locale: str, is_wanted: bool, code: str
) -> None:
    translations = part("gaussian_heritage_addon.language.translations")
    view = SimpleNamespace(use_translate_interface=is_wanted)
    fake = SimpleNamespace(
        app=SimpleNamespace(translations=SimpleNamespace(locale=locale)),
        context=SimpleNamespace(preferences=SimpleNamespace(view=view)),
    )
    monkeypatch.setattr(translations, "bpy", fake)
    assert translations.language().code == code


def test_german_texts_have_the_places_for_values_of_the_english_ones(part: Part) -> None:
    for text, own in german_texts(part).items():
        assert text.count("{") == own.count("{") and text.count("}") == own.count("}"), text
