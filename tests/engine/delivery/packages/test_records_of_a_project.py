"""What the records of a project say, in each form."""

from __future__ import annotations

import xml.etree.ElementTree as ET
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from engine.delivery.packages.captures import add_exif
from engine.delivery.packages.exporting import load_export, write_export
from engine.delivery.records import (
    Picture,
    crm_json_ld,
    describe_object,
    describe_scene,
    dublin_core,
    dublin_core_xml,
    iiif_manifest,
    lido_xml,
    ply_comments,
    record_summary,
    xmp_packet,
)
from engine.formats.glb import read_glb
from engine.formats.ply import read_ply
from engine.project.folder import ProjectFolder
from engine.scene import MeasuredDistance, Measurement, save_measurement
from tests.engine.pictures.blob_scene import BlobScene

from .conftest import TITLE, make_project

LIDO = "{http://www.lido-schema.org}"
ORDER = {
    "lidoWrap": ("lido",),
    "lido": (
        "lidoRecID",
        "objectPublishedID",
        "category",
        "applicationProfile",
        "descriptiveMetadata",
        "administrativeMetadata",
    ),
    "descriptiveMetadata": (
        *("objectClassificationWrap", "objectIdentificationWrap", "eventWrap", "objectRelationWrap"),
    ),
    "objectClassificationWrap": ("objectWorkTypeWrap", "classificationWrap"),
    "objectWorkTypeWrap": ("objectWorkType",),
    "objectWorkType": ("conceptID", "term"),
    "objectIdentificationWrap": (
        *("titleWrap", "inscriptionsWrap", "repositoryWrap", "displayStateEditionWrap", "objectDescriptionWrap"),
        *("objectMeasurementsWrap", "objectMaterialsTechWrap"),
    ),
    "titleWrap": ("titleSet",),
    "titleSet": ("appellationValue", "sourceAppellation"),
    "repositoryWrap": ("repositorySet",),
    "repositorySet": ("displayRepository", "repositoryName", "workID", "repositoryLocation", "sourceRepositorySet"),
    "objectDescriptionWrap": ("objectDescriptionSet",),
    "objectDescriptionSet": ("descriptiveNoteID", "descriptiveNoteValue", "sourceDescriptiveNote"),
    "eventWrap": ("eventSet",),
    "eventSet": ("displayEvent", "event"),
    "event": (
        *("eventID", "eventType", "roleInEvent", "eventName", "eventActor", "culture", "eventDate", "periodName"),
        *("eventPlace", "eventMethod", "eventMaterialsTech", "eventObjectMeasurements", "thingPresent"),
        *("relatedEventSet", "eventDescriptionSet"),
    ),
    "eventType": ("conceptID", "term"),
    "eventDate": ("displayDate", "date"),
    "date": ("earliestDate", "latestDate"),
    "eventDescriptionSet": ("descriptiveNoteID", "descriptiveNoteValue", "sourceDescriptiveNote"),
    "administrativeMetadata": ("rightsWorkWrap", "recordWrap", "resourceWrap"),
    "rightsWorkWrap": ("rightsWorkSet",),
    "rightsWorkSet": ("rightsType", "rightsDate", "rightsHolder", "creditLine"),
    "recordWrap": ("recordID", "recordType", "recordSource", "recordRights", "recordInfoSet", "collection"),
    "recordType": ("conceptID", "term"),
    "recordSource": ("legalBodyID", "legalBodyName", "legalBodyWeblink"),
    "legalBodyName": ("appellationValue", "sourceAppellation"),
    "recordInfoSet": ("recordInfoID", "recordInfoLink", "recordMetadataDate"),
    "objectMeasurementsWrap": ("objectMeasurementsSet",),
    "objectMeasurementsSet": ("displayObjectMeasurements", "objectMeasurements"),
    "objectMeasurements": ("measurementsSet", "extentMeasurements", "qualifierMeasurements"),
    "measurementsSet": ("measurementType", "measurementUnit", "measurementValue"),
    "resourceWrap": ("resourceSet",),
    "resourceSet": (
        *("resourceID", "resourceRepresentation", "resourceType", "resourceRelType", "resourcePerspective"),
        *("resourceDescription", "resourceDateTaken", "resourceSource", "rightsResource"),
    ),
    "resourceRepresentation": ("linkResource", "resourceMeasurementsSet"),
    "resourceType": ("conceptID", "term"),
}
"""Children of each element in the order that the schema of LIDO 1.1 demands."""
REQUIRED = {
    "lidoWrap": ("lido",),
    "lido": ("lidoRecID", "descriptiveMetadata", "administrativeMetadata"),
    "descriptiveMetadata": ("objectClassificationWrap", "objectIdentificationWrap"),
    "objectClassificationWrap": ("objectWorkTypeWrap",),
    "objectWorkTypeWrap": ("objectWorkType",),
    "objectIdentificationWrap": ("titleWrap",),
    "titleWrap": ("titleSet",),
    "titleSet": ("appellationValue",),
    "legalBodyName": ("appellationValue",),
    "measurementsSet": ("measurementType", "measurementUnit", "measurementValue"),
    "administrativeMetadata": ("recordWrap",),
    "recordWrap": ("recordID", "recordType", "recordSource"),
    "event": ("eventType",),
    "resourceRepresentation": ("linkResource",),
}
"""Children that the schema demands."""
IDENTIFIERS = ("lidoRecID", "conceptID", "recordID", "resourceID")
"""Elements of which the schema demands a type."""
ONCE = (
    *("objectClassificationWrap", "objectIdentificationWrap", "eventWrap", "eventType", "eventDate", "date"),
    *("recordWrap", "recordType", "resourceWrap", "resourceType", "linkResource", "measurementValue"),
)
"""Elements that may not be repeated within the element around them."""


@pytest.fixture
def described(project: ProjectFolder) -> dict[str, Any]:
    return describe_object(project, "kanne")


def test_paradata_tell_every_step_with_software_parameters_seed_inputs_and_outputs(described: dict[str, Any]) -> None:
    photos, training, objects = described["steps"]
    assert [step["stage"] for step in described["steps"]] == ["photos", "training", "objects"]
    assert training["seed"] == 5 and training["settings"] == {"seed": 5, "steps": 100}
    assert training["results"]["psnr"] == 27.25
    assert {"gaussian heritage", "python", "torch"} <= set(training["software"])
    assert [one["name"] for one in training["outputs"]] == ["gaussians/scene.ply"]
    hashes = {one["sha256"] for one in described["captures"]}
    assert len(hashes) == 8 and {one["sha256"] for one in photos["inputs"]} == hashes
    assert objects["inputs"] == training["outputs"]
    assert {one["name"] for one in objects["outputs"]} == {"objects/kanne/membership.npy"}


def test_paradata_tell_what_was_not_used_and_what_a_person_changed(described: dict[str, Any]) -> None:
    assert described["object"]["hand_edits"] == {"corrections": 1, "clicks_on": 1, "clicks_beside": 0}
    assert described["object"]["confidence"] == 0.75 and described["object"]["agreement"] == 0.5
    assert {one["name"]: one["use"] for one in described["captures"]}["view_3.png"] == "test"


def test_whole_title_and_unknown_unit_are_in_every_form(described: dict[str, Any]) -> None:
    texts = {
        "dublin core": dict(dublin_core(described))["title"],
        "extras": record_summary(described, frame="upright")["title"],
        "xmp": xmp_packet(described)["dc:title"]["rdf:_1"]["@value"],
        "iiif": iiif_manifest(described, [], address="https://example.org/", name="m.json")["label"]["none"][0],
        "crm": crm_json_ld(described)["@graph"][0]["label"],
        "comments": ply_comments(record_summary(described, frame="upright"))[0].removeprefix("title "),
    }
    assert texts == dict.fromkeys(texts, TITLE)
    assert "is not known" in record_summary(described, frame="upright")["unit"]
    assert "metres_per_unit" not in record_summary(described, frame="upright")
    assert any("is not known" in comment for comment in ply_comments(record_summary(described, frame="upright")))


def test_scene_is_called_after_its_photos(project: ProjectFolder, blobs: BlobScene, tmp_path: Path) -> None:
    other = make_project(blobs, tmp_path / "Antikensaal")
    assert describe_scene(other)["title"] == "Antikensaal"


def test_exif_facts_are_kept_and_places_and_serial_numbers_are_not(
    project: ProjectFolder, described: dict[str, Any]
) -> None:
    add_exif(project, described)
    exif = described["captures"][0]["exif"]
    assert exif["taken"] == "2026-05-01T10:20:30"
    assert (exif["camera_make"], exif["camera_model"], exif["iso"]) == ("Acme", "Phone 3", 200.0)
    assert exif["exposure_seconds"] == 0.005
    assert "4711" not in str(described) and "GPS" not in str(described)
    assert record_summary(described, frame="upright")["photos_taken"] == "2026-05-01 to 2026-05-03"


def test_photo_that_changed_has_no_exif_in_the_record(blobs: BlobScene, tmp_path: Path) -> None:
    project = make_project(blobs, tmp_path)
    photos = Path(str(project.get("photo_folder")))
    (photos / "view_0.png").write_bytes((photos / "view_1.png").read_bytes())
    (photos / "view_2.png").unlink()
    described = describe_scene(project)
    add_exif(project, described)
    missing = [one["name"] for one in described["captures"] if one["exif"] is None]
    assert missing == ["view_0.png", "view_2.png"]
    assert all("any more" in one["exif_missing"] for one in described["captures"] if one["exif"] is None)


def check_order(element: ET.Element) -> None:
    name = element.tag.removeprefix(LIDO)
    children = [child.tag.removeprefix(LIDO) for child in element]
    if name not in ORDER:
        assert children == [], f"{name} is not among the known elements"
        return
    places = [ORDER[name].index(child) for child in children]
    assert places == sorted(places), f"{name}: {children}"
    assert set(REQUIRED.get(name, ())) <= set(children), f"{name}: {children}"
    assert all(children.count(child) <= 1 for child in ONCE), f"{name}: {children}"
    for child in element:
        check_order(child)


@pytest.mark.parametrize("is_object", [True, False])
def test_lido_has_the_elements_of_its_schema_in_their_order(
    project: ProjectFolder, described: dict[str, Any], is_object: bool
) -> None:
    text = lido_xml(described if is_object else describe_scene(project), [("kanne.glb", "model/gltf-binary")])
    root = ET.fromstring(text)
    check_order(root)
    for element in root.iter():
        if element.tag.removeprefix(LIDO) in IDENTIFIERS:
            assert element.get(f"{LIDO}type"), "identifiers have a type"
    lang = "{http://www.w3.org/XML/1998/namespace}lang"
    assert all(root.find(f".//{LIDO}{name}").get(lang) for name in ("descriptiveMetadata", "administrativeMetadata"))  # type: ignore[union-attr]


def test_lido_has_the_museums_fields(described: dict[str, Any]) -> None:
    root = ET.fromstring(lido_xml(described))
    texts = {name: root.findtext(f".//{LIDO}{name}") for name in ("appellationValue", "workID", "creditLine")}
    assert texts == {"appellationValue": TITLE, "workID": "1906.12", "creditLine": "CC BY 4.0, Musée"}


def test_lido_says_what_each_file_is_and_where_it_is_published(described: dict[str, Any]) -> None:
    files = [("kanne.ply", "application/x-ply"), ("kanne.html", "text/html"), ("pictures/a b.png", "image/png")]
    root = ET.fromstring(lido_xml(described, files, address="https://museum.example/kanne/"))
    check_order(root)
    found = {
        name: [one.text or "" for one in root.iter(f"{LIDO}{name}")]
        for name in ("resourceID", "linkResource", "resourceDescription")
    }
    assert found["resourceID"] == [name for name, _ in files]
    assert found["linkResource"] == [
        f"https://museum.example/kanne/{name}" for name in ("kanne.ply", "kanne.html", "pictures/a%20b.png")
    ]
    kinds = [one.findtext(f"{LIDO}term") for one in root.iter(f"{LIDO}resourceType")]
    assert kinds == ["3D model", "web page", "digital image"]
    assert all(TITLE in text for text in found["resourceDescription"])
    assert ["is not known" in text for text in found["resourceDescription"]] == [True, False, False]


@pytest.mark.parametrize(("is_object", "level"), [(True, "Item-level record"), (False, "Group-level record")])
def test_lido_says_what_the_record_describes_and_when_it_was_made(
    project: ProjectFolder, described: dict[str, Any], is_object: bool, level: str
) -> None:
    one = described if is_object else describe_scene(project)
    root = ET.fromstring(lido_xml(one))
    assert root.findtext(f".//{LIDO}recordType/{LIDO}term") == level
    assert root.findtext(f".//{LIDO}recordMetadataDate") == one["exported"]["finished"]


def test_characters_that_xml_cannot_hold_do_not_break_it(described: dict[str, Any]) -> None:
    root = ET.fromstring(dublin_core_xml(described))
    notes = [one.text for one in root.iter("{http://purl.org/dc/elements/1.1/}description")]
    assert "first line\nsecond\ufffd line" in notes


def test_every_reference_of_the_provenance_leads_to_a_node(described: dict[str, Any]) -> None:
    document = crm_json_ld(described)
    nodes = {node["@id"] for node in document["@graph"]}
    references = set()

    def collect(value: Any) -> None:
        if isinstance(value, dict):
            if set(value) == {"@id"}:
                references.add(value["@id"])
            for one in value.values():
                collect(one)
        elif isinstance(value, list):
            for one in value:
                collect(one)

    collect(document["@graph"])
    assert references and references <= nodes
    assert [node["@type"] for node in document["@graph"]].count("crmdig:D10_Software_Execution") == 3


def test_iiif_manifest_has_a_canvas_with_its_picture_for_each_view(described: dict[str, Any]) -> None:
    pictures = [Picture(f"pictures/view {n}.jpg", f"View {n}", 512, 384) for n in range(3)]
    manifest = iiif_manifest(described, pictures, address="https://museum.example/kanne/", name="iiif/manifest.json")
    assert manifest["id"] == "https://museum.example/kanne/iiif/manifest.json"
    assert manifest["requiredStatement"]["value"] == {"none": ["CC BY 4.0, Musée"]}
    for canvas in manifest["items"]:
        (page,) = canvas["items"]
        (annotation,) = page["items"]
        assert annotation["target"] == canvas["id"]
        assert (canvas["width"], canvas["height"]) == (512, 384)
        assert annotation["body"]["id"].startswith("https://museum.example/kanne/pictures/view%20")
    assert len({canvas["id"] for canvas in manifest["items"]}) == 3


@pytest.mark.parametrize("name", [None, "kanne"])
def test_files_carry_the_record_unless_none_is_wanted(project: ProjectFolder, tmp_path: Path, name: str | None) -> None:
    export = load_export(project, name)
    for file_format in ("ply", "glb"):
        full, none = (tmp_path / f"{word}.{file_format}" for word in ("full", "none"))
        write_export(full, export, file_format, frame="upright")
        write_export(none, export, file_format, frame="upright", with_record=False)
        assert b"is not known" in full.read_bytes()
        # Which axis is up belongs to the coordinates.
        head = none.read_bytes()[:2000].replace(b"comment up_axis -y\n", b"")
        assert b"comment" not in head and b"extras" not in head and b"KHR_xmp" not in head
    assert b"KHR_xmp_json_ld" in (tmp_path / "full.glb").read_bytes()
    assert len(read_glb(tmp_path / "full.glb")) == len(export.gaussians)


def test_measured_project_has_metres_and_the_size_of_the_object(blobs: BlobScene, tmp_path: Path) -> None:
    project = make_project(blobs, tmp_path)
    # The ball is about 0.55 units wide; two units are a metre.
    save_measurement(project.path, Measurement((MeasuredDistance((0.0, 0.0, 0.0), (2.0, 0.0, 0.0), 1.0),)))
    export = load_export(project, "kanne")
    assert export.described["unit"]["metres_per_unit"] == pytest.approx(0.5)
    assert "Files are in metres, from 1 distance measured" in export.described["unit"]["text"]
    size = export.described["size"]
    assert size["width_metres"] == pytest.approx(np.ptp(export.gaussians.means[:, 0]) / 2, rel=0.1)
    root = ET.fromstring(lido_xml(export.described))
    check_order(root)
    values = [float(one.text or "") for one in root.iter(f"{LIDO}measurementValue")]
    assert values == pytest.approx([size[f"{name}_metres"] for name in ("width", "depth", "height")], abs=1e-4)
    out = tmp_path / "kanne.ply"
    write_export(out, export, "ply", frame=None)
    head = out.read_bytes().split(b"end_header")[0].decode()
    assert "comment unit metre" in head and "comment size " in head and "is not known" not in head
    assert np.ptp(read_ply(out).means[:, 0]) == pytest.approx(np.ptp(export.gaussians.means[:, 0]) / 2, rel=1e-4)
