"""The graph of a scene in a file, made again where the file does not hold it."""

from __future__ import annotations

import hashlib
import itertools
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import csr_matrix

from ..core.arrays import Int32
from ..core.events import StopCheck
from ..core.files import ArraySpec, keep_arrays, read_kept_arrays
from ..project.folder import stage_key
from .graph import SceneGraph, build_graph
from .views import Views

_VERSION = "graph 4"


def load_or_build_graph(
    file: Path | None, views: Views, label_maps: Mapping[str, Int32], *, n_views: int, should_stop: StopCheck
) -> SceneGraph:
    """Return the graph stored in `file`, or build and store it; else as `build_graph`.

    A missing, damaged or outdated file is made again; a file that cannot be written only costs time.
    """
    gaussians, digest = views.scene.gaussians, hashlib.sha256()
    assert gaussians.features is not None
    photos = [camera.photo for camera in views.cameras.cameras if camera.photo in label_maps]
    of_scene = (gaussians.means, gaussians.opacities, gaussians.features)
    for array in itertools.chain(of_scene, map(label_maps.__getitem__, photos)):
        digest.update(np.ascontiguousarray(array).data)
    recipe = stage_key(_VERSION, n_views, views.render_side, photos, digest.hexdigest())
    graph = None if file is None else read_graph(file, recipe, len(views.scene))
    if graph is None:
        graph = replace(build_graph(views, label_maps, n_views=n_views, should_stop=should_stop), key=recipe)
        if file is not None:
            keep_arrays(file, recipe, _to_arrays(graph))
    return graph


def read_graph(file: Path, key: str, count: int) -> SceneGraph | None:
    """Return the graph of `count` Gaussians that is kept in `file`; None for a missing, damaged or another one."""
    stored = read_kept_arrays(file, key, _SPECS)
    return None if stored is None else _from_arrays(stored, count, key)


_MATRICES = ("neighbours", "segments")
_SPECS = {
    "photo": ArraySpec("int32", ("m",)),
    "photos": ArraySpec("str", ("p",)),
    **{f"{name} values": ArraySpec("float32", (f"{name} links",), finite=True) for name in _MATRICES},
    **{f"{name} columns": ArraySpec("int32", (f"{name} links",)) for name in _MATRICES},
    **{f"{name} rows": ArraySpec("int32", ("n",)) for name in _MATRICES},
}


def _to_arrays(graph: SceneGraph) -> dict[str, NDArray[np.generic]]:
    arrays = {"photo": graph.photo, "photos": np.array(graph.photos, np.str_)}
    for name in _MATRICES:
        matrix = getattr(graph, name)
        arrays |= {f"{name} values": matrix.data, f"{name} columns": matrix.indices, f"{name} rows": matrix.indptr}
    return {name: array.astype(_SPECS[name].dtype, copy=False) for name, array in arrays.items()}


def _from_arrays(arrays: dict[str, NDArray[Any]], count: int, key: str) -> SceneGraph | None:
    """Return the graph; None when the arrays are not its matrices."""
    photo, photos = arrays["photo"], tuple(arrays["photos"].tolist())
    right = np.isin(np.diff(photo, prepend=-1), (0, 1)).all() and photo.max(initial=-1) < len(photos)
    matrices: dict[str, csr_matrix] = {}
    for name, width in zip(_MATRICES, (count, len(photo)), strict=True):
        parts = tuple(arrays[f"{name} {part}"] for part in ("values", "columns", "rows"))
        try:
            matrices[name] = csr_matrix(parts, shape=(count, width))
            matrices[name].check_format(full_check=True)
        except ValueError:
            return None
        right = right and not (matrices[name].data < 0).any()
    return SceneGraph(photo=photo, photos=photos, key=key, **matrices) if right else None
