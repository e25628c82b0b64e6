"""The ``cpu`` backend: Numba kernels with explicit SIMD, wrapped in one autograd function.

Any number of threads gives the same bits, because every tile and every Gaussian is computed by one thread and sums are
taken in a fixed order. Torch does no part of the work: on a busy machine its OpenMP threads spin at every barrier. See
docs/design_notes/rasterizer.md.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray
from torch.autograd.function import once_differentiable

from ..core.arrays import Float32, Int32
from ..core.errors import NumericalError
from ..scene import PinholeCamera
from .blend_backward import MOMENTS_SIZE, blend_tiles_backward
from .blend_forward import GEOMETRY_SIZE, blend_tiles
from .projection import (
    CULLED_DEGENERATE,
    CULLED_NEAR,
    CULLED_OUTSIDE,
    CULLED_TRANSPARENT,
    VISIBLE,
    Projected,
    pack_camera,
    project_gaussians,
)
from .projection_backward import project_gaussians_backward
from .raster import CulledCounts, Raster, RasterInputs, check_finite, input_tensors
from .settings import RasterSettings
from .threads import Share, run_shared
from .tiles import TileLists, make_tile_lists


@dataclass
class View:
    """Camera and settings of an image, and the results of its forward pass that the backward pass needs.

    Attributes
    ----------
    camera : PinholeCamera
    sh_degree : int
    settings : RasterSettings
    projected : Projected, optional
        Set by `project_view`.
    lists : TileLists, optional
        Set by `project_view`; M pairs of a tile and a Gaussian.
    masks : uint16 array of shape [M], optional
        Set by `blend_view`: the blocks of 4x4 pixels of its tile that each pair changes.
    geometry : float32 array of shape [M GEOMETRY_SIZE], optional
        Set by `blend_view`: each pair's ellipse relative to its tile.
    n_moving : int, optional
        Number of channels, from the first on, whose gradient reaches the geometry; all by default.
    """

    camera: PinholeCamera
    sh_degree: int
    settings: RasterSettings
    projected: Projected | None = None
    lists: TileLists | None = None
    masks: NDArray[np.uint16] | None = None
    geometry: Float32 | None = None
    n_moving: int | None = None


def _array(tensor: torch.Tensor) -> Float32:
    """Return the values of a float32 tensor, without a copy if it is contiguous."""
    return tensor.detach().contiguous().numpy()


def _n_channels(sh: Float32, channels: Float32) -> int:
    """Return how many channels the image of Gaussians with `sh` [N, n_sh, 3] and `channels` [N, C] has."""
    return (3 if sh.shape[1] else 0) + channels.shape[1]


class _Rasterize(torch.autograd.Function):
    """Rasterization as an autograd function that returns image and transmittance.

    Its inputs are means, quats, scales, opacities, sh [N, n_sh or 0, 3], channels [N, C or 0], viewmat [4, 4] with the
    values of the view's camera, and the `View`.
    """

    @staticmethod
    def forward(ctx: Any, *arguments: Any) -> tuple[torch.Tensor, torch.Tensor]:
        *tensors, _, view = arguments
        means, quats, scales, opacities, sh, channels = (_array(tensor) for tensor in tensors)
        project_view(view, means, quats, scales, opacities, sh, channels)
        image, transmittance = blend_view(view, _n_channels(sh, channels))
        ctx.view = view
        ctx.set_materialize_grads(False)
        ctx.save_for_backward(*tensors)
        return torch.from_numpy(image), torch.from_numpy(transmittance)

    @staticmethod
    @once_differentiable
    def backward(  # type: ignore[override]
        ctx: Any, image_gradient: torch.Tensor | None, transmittance_gradient: torch.Tensor | None
    ) -> Any:
        view: View = ctx.view
        tensors = ctx.saved_tensors
        arrays = tuple(_array(tensor) for tensor in tensors)
        if image_gradient is None:
            n_channels = _n_channels(arrays[4], arrays[5])
            image_gradient = torch.zeros(view.camera.height, view.camera.width, n_channels)
        if transmittance_gradient is None:
            transmittance_gradient = torch.empty(0)
        pairs = pair_gradients(view, _array(image_gradient), _array(transmittance_gradient))
        with_pose = ctx.needs_input_grad[len(tensors)]
        outputs, pose_gradients = gaussian_gradients(view, arrays, pairs, with_pose=with_pose)
        gradients = [torch.from_numpy(output) for output in outputs]
        pose_gradient = None
        if with_pose:
            total = pose_gradients.sum(axis=0)
            pose_gradient = torch.zeros(4, 4, dtype=torch.float64)
            pose_gradient[:3, :3], pose_gradient[:3, 3] = (
                torch.from_numpy(total[:9].reshape(3, 3)),
                torch.from_numpy(total[9:]),
            )
            check_finite("gradient of viewmat", pose_gradient)
        return (*gradients, pose_gradient, None)


def project_view(
    view: View,
    means: Float32,
    quats: Float32,
    scales: Float32,
    opacities: Float32,
    sh: Float32,
    channels: Float32,
) -> None:
    """Project the Gaussians and list them by tile and depth; this sets `projected` and `lists` of `view`.

    Parameters
    ----------
    means, quats, scales, opacities, sh, channels : float32 arrays
        As in `engine.rasterizer.rasterize`. Without `sh`, its shape is [N, 0, 3]; without `channels`, [N, 0].

    Raises
    ------
    NumericalError
        If an array is not finite.
    """
    width, height, n = view.camera.width, view.camera.height, len(means)
    projected = Projected.empty(n, padded_channels(_n_channels(sh, channels)))
    packed_camera = pack_camera(view.camera, view.settings)
    center = np.ascontiguousarray(view.camera.center, dtype=np.float64)

    def project(share: Share) -> int:
        return project_gaussians(
            share, means, quats, scales, opacities, sh, view.sh_degree, channels,
            packed_camera, center, width, height, projected.state, projected.pixels, projected.roots,
            projected.screen_opacities, projected.limits, projected.depths, projected.radii, projected.colors,
            projected.n_tiles, projected.spans,
        )  # fmt: skip

    if sum(run_shared(project, view.settings.threads)):
        _raise_not_finite("", (means, quats, scales, opacities, sh, channels))
    view.projected, view.lists = projected, make_tile_lists(projected, width, height, view.settings.threads)


def blend_view(view: View, n_channels: int, tiles: Int32 | None = None) -> tuple[Float32, Float32]:
    """Blend the projected colours front to back; this sets `masks` and `geometry` of `view`.

    Parameters
    ----------
    view : View
        After `project_view`.
    n_channels : int
        Number of projected colours without their padding.
    tiles : int32 array, optional
        Tiles to blend, numbered row by row from 0. Image and transmittance are zero in the others. All tiles must have
        been blended once before. All tiles by default.

    Returns
    -------
    image : float32 array of shape [H, W, n_channels]
    transmittance : float32 array of shape [H, W]
    """
    projected, lists = view.projected, view.lists
    assert projected is not None and lists is not None
    width, height = view.camera.width, view.camera.height
    # When all tiles are blended, every pixel is written.
    allocate, selected_tiles = (np.empty, lists.all_tiles) if tiles is None else (np.zeros, tiles)
    image = allocate((height, width, n_channels), np.float32)
    transmittance = allocate((height, width), np.float32)
    n_pairs = len(lists.gaussians)
    masks = np.empty(n_pairs, np.uint16) if view.masks is None else view.masks
    geometry = np.empty(n_pairs * GEOMETRY_SIZE, np.float32)
    n_colors = projected.colors.shape[1]
    flat_image, flat_transmittance = image.reshape(-1), transmittance.reshape(-1)
    flat_colors = projected.colors.reshape(-1)

    def blend(share: Share) -> None:
        blend_tiles(
            share, selected_tiles, width, height, lists.tile_start, lists.gaussians, projected.pixels.reshape(-1),
            projected.roots.reshape(-1), projected.limits, projected.screen_opacities, flat_colors, n_colors,
            n_channels, flat_image, flat_transmittance, masks, geometry,
        )  # fmt: skip

    run_shared(blend, view.settings.threads)
    view.masks, view.geometry = masks, geometry
    return image, transmittance


def padded_channels(n_channels: int) -> int:
    """Return `n_channels` rounded up to a multiple of 4, the number of channels that the kernels blend together."""
    return (n_channels + 3) // 4 * 4


def pair_gradients(
    view: View, image_gradient: Float32, transmittance_gradient: Float32, tiles: Int32 | None = None
) -> Float32:
    """Propagate the gradients of an image back to the pairs of a tile and a Gaussian.

    Parameters
    ----------
    view : View
        After the forward pass, with M pairs.
    image_gradient : float32 array of shape [H, W, K]
    transmittance_gradient : float32 array of shape [H, W], or empty for zero
    tiles : int32 array, optional
        Tiles to process; the rows of pairs in other tiles are undefined. All tiles by default.

    Returns
    -------
    float32 array of shape [M, MOMENTS_SIZE + K4]
        Rows in the order of the tiles' lists; K4 is K rounded up to a multiple of 4.

    Raises
    ------
    NumericalError
        If a gradient of the image is not finite.
    """
    projected, lists, masks, geometry = view.projected, view.lists, view.masks, view.geometry
    assert projected is not None and lists is not None and masks is not None and geometry is not None
    height, width, n_channels = image_gradient.shape
    n_colors = projected.colors.shape[1]
    pairs = np.empty((len(lists.gaussians), MOMENTS_SIZE + n_colors), np.float32)
    flat_colors, flat_pairs = projected.colors.reshape(-1), pairs.reshape(-1)
    flat_image, flat_transmittance = image_gradient.reshape(-1), transmittance_gradient.reshape(-1)
    selected_tiles = lists.all_tiles if tiles is None else tiles
    n_moving = n_channels if view.n_moving is None else view.n_moving

    def blend_backward(share: Share) -> int:
        return blend_tiles_backward(
            share, selected_tiles, width, height, lists.tile_start, lists.gaussians, geometry, flat_colors, n_colors,
            n_channels, n_moving, masks, flat_image, flat_transmittance, flat_pairs,
        )  # fmt: skip

    n_bad = sum(run_shared(blend_backward, view.settings.threads))
    if n_bad:
        raise NumericalError(
            f"the gradient of the image is not finite in {n_bad} blocks of 4x4 pixels; check the loss that produced it."
        )
    return pairs


def gaussian_gradients(
    view: View, arrays: tuple[Float32, ...], pairs: Float32, *, with_pose: bool
) -> tuple[list[Float32], NDArray[np.float64]]:
    """Sum the gradients of each Gaussian's pairs and propagate them back through the projection.

    Parameters
    ----------
    view : View
        After the forward pass.
    arrays : tuple of float32 arrays
        means, quats, scales, opacities, sh, channels, as in the forward pass.
    pairs : float32 array of shape [M, MOMENTS_SIZE + K4]
        Result of `pair_gradients`.
    with_pose : bool
        Also compute the gradient of the camera's pose.

    Returns
    -------
    gradients : list of float32 arrays
        Gradients of `arrays`, with the same shapes.
    pose_gradients : float64 array of shape [N, 12], or [0, 12] without pose
        Each Gaussian's part of the gradient of the view's rotation, row by row, and translation.

    Raises
    ------
    NumericalError
        If one of `gradients` is not finite.
    """
    projected, lists = view.projected, view.lists
    assert projected is not None and lists is not None
    means, quats, scales, opacities, sh, channels = arrays
    outputs = [np.empty(array.shape, np.float32) for array in arrays]
    pose_gradients = np.zeros((len(means) if with_pose else 0, 12))
    packed_camera = pack_camera(view.camera, view.settings)
    center = np.ascontiguousarray(view.camera.center, dtype=np.float64)
    flat_pairs = pairs.reshape(-1)

    def project_backward(share: Share) -> int:
        return project_gaussians_backward(
            share, projected.state, lists.pair_start, lists.list_positions, flat_pairs, means,
            quats, scales, opacities, sh, view.sh_degree, packed_camera, center, projected.colors,
            channels.shape[1], *outputs, pose_gradients,
        )  # fmt: skip

    if sum(run_shared(project_backward, view.settings.threads)):
        _raise_not_finite("gradient of ", outputs)
    return outputs, pose_gradients


def _raise_not_finite(prefix: str, arrays: Sequence[Float32]) -> None:
    """Raise `NumericalError` for the first of `arrays` (means, quats, ... channels) that is not finite."""
    for name, array in zip(("means", "quats", "scales", "opacities", "sh", "channels"), arrays, strict=True):
        check_finite(prefix + name, torch.from_numpy(array))


def rasterize_cpu(inputs: RasterInputs) -> Raster:
    """Render as `engine.rasterizer.rasterize` describes.

    Raises
    ------
    NumericalError
        If an input is not finite, which the projection detects.
    ValueError
        If a tensor is not float32 on the CPU.
    """
    tensors = input_tensors(inputs, "cpu")
    view = View(inputs.camera, inputs.sh_degree, inputs.settings)
    if inputs.detached_channels:
        view.n_moving = 0 if inputs.sh is None else 3
    image, transmittance = _Rasterize.apply(*tensors, inputs.viewmat.double(), view)
    assert view.projected is not None
    state = view.projected.state
    culled = CulledCounts(
        near=int(np.count_nonzero(state == CULLED_NEAR)),
        degenerate=int(np.count_nonzero(state == CULLED_DEGENERATE)),
        transparent=int(np.count_nonzero(state == CULLED_TRANSPARENT)),
        outside=int(np.count_nonzero(state == CULLED_OUTSIDE)),
    )
    visible = torch.from_numpy(state == VISIBLE)
    return Raster(image, transmittance, visible, torch.from_numpy(view.projected.radii), culled)
