"""Cameras that Agisoft Metashape exports as XML (*File > Export > Export Cameras*).

Camera transforms are camera-to-world with x right, y down, z forward, in the frame of a component of a chunk, which has
a similarity to the world if it is scaled or georeferenced. Principal points are offsets from the centre of the picture
as it is stored. The formulas of the lenses are in the Metashape manual, see `brown_lens`.
"""

from __future__ import annotations

import xml.etree.ElementTree as ET
from pathlib import Path
from typing import Any

import numpy as np

from ..core.arrays import Float64
from ..core.errors import CameraError
from ..scene import MAX_COORDINATE, MAX_PHOTO_SIDE, is_rotation
from .brown_lens import BrownLens
from .model_reading import write_model_arrays
from .safe_xml import numbers_of, parsed_xml

_ADVICE = "Export the cameras again as XML, or as a COLMAP model (File > Export > Export Cameras > Colmap)."
_FRAME, _FISHEYE = ("frame",), ("fisheye", "equidistant_fisheye")
_OFF = ("false", "0", "no")


def metashape_in_child(source: str, target: str, what: str) -> dict[str, Any]:
    """Write the world-to-camera matrices of an export to `target`; return names, lenses and parts of its cameras.

    Parameters
    ----------
    source, target : str
        The XML file, and the file for arrays.
    what : str
        For messages.

    Raises
    ------
    CameraError
        When the file is damaged, or has lenses or poses that cannot be used.
    """
    root = parsed_xml(Path(source), _ADVICE)
    chunks = [root] if root.tag == "chunk" else [chunk for chunk in root.iter("chunk") if not _is_off(chunk)]
    images: list[tuple[str, int, str]] = []
    lenses: list[dict[str, Any]] = []
    viewmats: list[Float64] = []
    for number, chunk in enumerate(chunks):
        try:
            _read_chunk(chunk, f"chunk {chunk.get('label') or number + 1}", images, lenses, viewmats)
        except ValueError as error:
            raise CameraError(f"{what} cannot be used: {error}. {_ADVICE}") from error
    stacked = np.array(viewmats).reshape(-1, 4, 4)
    write_model_arrays(Path(target), np.zeros((0, 3)), np.zeros((0, 3), np.uint8), {"viewmats": stacked})
    return {"images": images, "lenses": lenses}


def _is_off(element: ET.Element) -> bool:
    return element.get("enabled", "true").lower() in _OFF


def _read_chunk(
    chunk: ET.Element,
    label: str,
    images: list[tuple[str, int, str]],
    lenses: list[dict[str, Any]],
    viewmats: list[Float64],
) -> None:
    """Add the placed cameras of a chunk to the lists; raises `ValueError` for one that cannot be used."""
    sensors = {sensor.get("id"): sensor for sensor in chunk.findall("sensors/sensor")}
    of_chunk = _similarity(chunk.find("transform"))
    components = {
        component.get("id"): (component.get("label") or component.get("id"), _similarity(component.find("transform")))
        for component in chunk.findall("components/component")
    }
    lens_of: dict[str | None, int] = {}
    for camera in (camera for group in chunk.findall("cameras") for camera in group.iter("camera")):
        transform = camera.find("transform")
        if transform is None or _is_off(camera):
            continue
        name, sensor = camera.get("label") or "", camera.get("sensor_id")
        if sensor not in lens_of:
            if sensor not in sensors:
                raise ValueError(f"the camera {name} has no sensor")
            lens_of[sensor] = len(lenses)
            lenses.append(_lens(sensors[sensor]))
        component, to_world = components.get(camera.get("component_id"), (None, None))
        if to_world is None:
            to_world = of_chunk
        # What has no place in the world has one in its own component only.
        part = label if to_world is not None or len(components) < 2 else f"{label}, {component}"
        matrix = np.array(numbers_of(transform.text, 16)).reshape(4, 4)
        images.append((name, lens_of[sensor], part))
        viewmats.append(_viewmat(matrix, to_world, name))


def _similarity(transform: ET.Element | None) -> Float64 | None:
    """Return the similarity [4, 4] of a chunk or a component; None where there is none."""
    if transform is None:
        return None
    matrix = np.eye(4)
    if (transform.text or "").strip():
        matrix = np.array(numbers_of(transform.text, 16)).reshape(4, 4)
    else:
        rotation, translation, scale = (transform.find(name) for name in ("rotation", "translation", "scale"))
        if rotation is not None:
            matrix[:3, :3] = np.array(numbers_of(rotation.text, 9)).reshape(3, 3)
        if scale is not None:
            matrix[:3, :3] *= numbers_of(scale.text, 1)[0]
        if translation is not None:
            matrix[:3, 3] = numbers_of(translation.text, 3)
    size = float(np.cbrt(np.linalg.det(matrix[:3, :3]))) if np.isfinite(matrix).all() else 0.0
    if not size > 0.0 or not is_rotation(matrix[:3, :3] / size):
        raise ValueError("the transform of a chunk or a component is not a rotation, a scale and a translation")
    return matrix


def _viewmat(matrix: Float64, to_world: Float64 | None, name: str) -> Float64:
    if not (np.isfinite(matrix).all() and is_rotation(matrix[:3, :3])):
        raise ValueError(f"the transform of the camera {name} is not a rotation and a translation")
    rotation, center = matrix[:3, :3], matrix[:3, 3]
    if to_world is not None:
        size = np.cbrt(np.linalg.det(to_world[:3, :3]))
        rotation, center = to_world[:3, :3] / size @ rotation, to_world[:3, :3] @ center + to_world[:3, 3]
    left, _, right = np.linalg.svd(rotation)
    viewmat = np.eye(4)
    viewmat[:3, :3] = (left @ right).T
    viewmat[:3, 3] = -viewmat[:3, :3] @ center
    if not (np.abs(viewmat) <= MAX_COORDINATE).all():
        raise ValueError(f"the position of the camera {name} is too large")
    return viewmat


def _lens(sensor: ET.Element) -> dict[str, Any]:
    """Return the lens of a sensor as the arguments of `BrownLens`, or what is wrong with it as ``problem``."""
    label = sensor.get("label") or sensor.get("id") or ""
    kind = (sensor.get("type") or "frame").lower()
    if kind not in (*_FRAME, *_FISHEYE):
        return {"problem": f"the sensor {label} is of the type {kind}, which is not supported"}
    found = {calibration.get("class", ""): calibration for calibration in sensor.findall("calibration")}
    calibration = next((found[key] for key in ("adjusted", "", "initial") if key in found), None)
    if calibration is None:
        return {"problem": f"the sensor {label} has no calibration: align the photos first"}

    def value(name: str, default: float = 0.0) -> float:
        text = calibration.findtext(name)
        return default if text is None else numbers_of(text, 1)[0]

    if any(value(name) for name in ("p3", "p4")):
        return {"problem": f"the sensor {label} has p3 or p4, which are not supported"}
    resolution = calibration.find("resolution")
    resolution = sensor.find("resolution") if resolution is None else resolution
    if resolution is None:
        return {"problem": f"the sensor {label} has no resolution"}
    width, height = (int(numbers_of(resolution.get(side), 1)[0]) for side in ("width", "height"))
    if not (1 <= width <= MAX_PHOTO_SIDE and 1 <= height <= MAX_PHOTO_SIDE):
        return {"problem": f"the sensor {label} cannot have {width} x {height} pixels"}
    # Before version 1.0, fx and fy were given, and the principal point from the corner.
    is_old = calibration.find("fx") is not None
    fy = value("fy" if is_old else "f")
    arguments: dict[str, Any] = {
        "width": width,
        "height": height,
        "fx": value("fx") if is_old else fy + value("b1"),
        "fy": fy,
        "cx": value("cx", 0.5 * width) if is_old else 0.5 * width + value("cx"),
        "cy": value("cy", 0.5 * height) if is_old else 0.5 * height + value("cy"),
        "radial": [value(name) for name in ("k1", "k2", "k3", "k4")],
        "tangential": [value(name) for name in ("p1", "p2")],
        "skew": value("skew") if is_old else value("b2"),
        "fisheye": kind in _FISHEYE,
    }
    try:
        BrownLens(**arguments).as_lens()
    except ValueError as error:
        return {"problem": f"the sensor {label}: {error}"}
    return arguments
