"""How a result was made, as JSON-LD in the terms of CIDOC CRM and its extension CRMdig."""

from __future__ import annotations

from typing import Any
from urllib.parse import quote

_CONTEXT = {
    "crm": "http://www.cidoc-crm.org/cidoc-crm/",
    "crmdig": "http://www.ics.forth.gr/isl/CRMdig/",
    "rdfs": "http://www.w3.org/2000/01/rdf-schema#",
    "xsd": "http://www.w3.org/2001/XMLSchema#",
    "label": "rdfs:label",
}


def crm_json_ld(described: dict[str, Any]) -> dict[str, Any]:
    """Return the chain of steps: photographs, software executions with their inputs and outputs, and the thing shown.

    Parameters
    ----------
    described : dict
        As returned by `describe_scene` or `describe_object`.

    Returns
    -------
    dict
        ``@context`` and ``@graph``. A digital object is named by its SHA-256, so that the same file is the same node
        in every record.
    """
    graph: dict[str, dict[str, Any]] = {}
    thing = {
        "@id": "#thing",
        "@type": "crm:E22_Human-Made_Object" if "object" in described else "crm:E18_Physical_Thing",
        "label": described["title"],
        "crm:P1_is_identified_by": _identifiers(described),
    }
    rights = (described.get("object") or {}).get("rights")
    if rights:
        thing["crm:P104_is_subject_to"] = {"@type": "crm:E30_Right", "label": rights}
    graph["#thing"] = thing
    photographed = [_digital_object(graph, photo) for photo in described["captures"]]
    graph["#photographing"] = {
        "@id": "#photographing",
        "@type": "crmdig:D2_Digitization_Process",
        "label": f"photographing, {len(photographed)} photographs",
        "crmdig:L1_digitized": {"@id": "#thing"},
        "crmdig:L11_had_output": photographed,
    }
    for step in described["steps"]:
        execution = _execution(graph, step)
        graph[execution["@id"]] = execution
    result = described["steps"][-1]["outputs"] if described["steps"] else []
    for one in result:
        graph[_name_of(one)]["crm:P138_represents"] = {"@id": "#thing"}
    return {"@context": _CONTEXT, "@graph": list(graph.values())}


def _identifiers(described: dict[str, Any]) -> list[dict[str, Any]]:
    number = (described.get("object") or {}).get("catalogue_number")
    titles: list[dict[str, Any]] = [
        {"@type": "crm:E35_Title", "crm:P190_has_symbolic_content": described["title"]},
    ]
    if number:
        titles.append({"@type": "crm:E42_Identifier", "crm:P190_has_symbolic_content": number})
    return titles


def _execution(graph: dict[str, dict[str, Any]], step: dict[str, Any]) -> dict[str, Any]:
    execution: dict[str, Any] = {
        "@id": f"#step-{step['stage']}",
        "@type": "crmdig:D10_Software_Execution",
        "label": step["what"],
        "crmdig:L10_had_input": [_digital_object(graph, one) for one in step["inputs"]],
        "crmdig:L11_had_output": [_digital_object(graph, one) for one in step["outputs"]],
        "crmdig:L23_used_software_or_firmware": _software(graph, step),
    }
    if step["finished"]:
        end = {"@type": "xsd:dateTime", "@value": step["finished"]}
        execution["crm:P4_has_time-span"] = {
            "@type": "crm:E52_Time-Span",
            "crm:P82b_end_of_the_end": end,
        }
    if step["settings"]:
        parameters = ", ".join(f"{name}={value}" for name, value in step["settings"].items())
        execution["crmdig:L13_used_parameters"] = {
            "@type": "crmdig:D1_Digital_Object",
            "crm:P3_has_note": parameters,
        }
    if step["results"]:
        results = ", ".join(f"{name}={value}" for name, value in step["results"].items())
        execution["crm:P3_has_note"] = results
    return execution


def _software(graph: dict[str, dict[str, Any]], step: dict[str, Any]) -> list[dict[str, str]]:
    programs = []
    for name, version in (step["software"] or {}).items():
        key = f"#software-{quote(f'{name}-{version}', safe='')}"
        program: dict[str, Any] = {"@id": key, "@type": "crmdig:D14_Software", "label": f"{name} {version}"}
        if name == "gaussian heritage" and step["commit"]:
            program["@id"] = key = f"{key}-{step['commit']}"
            changed = ", with changes that are in no commit" if step["changed"] else ""
            program["crm:P3_has_note"] = f"commit {step['commit']}{changed}"
        graph[key] = program
        programs.append({"@id": key})
    return programs


def _digital_object(graph: dict[str, dict[str, Any]], file: dict[str, Any]) -> dict[str, str]:
    """Add a file to the graph and return the reference to it."""
    name = _name_of(file)
    graph.setdefault(name, {"@id": name, "@type": "crmdig:D1_Digital_Object", "label": file["name"]})
    return {"@id": name}


def _name_of(file: dict[str, Any]) -> str:
    return f"urn:sha256:{file['sha256']}"
