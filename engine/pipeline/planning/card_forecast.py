"""Memory and time of training on a graphics card, from the buffers of `rasterizer.gpu` and the figures of docs/gpu.md.

The constants of the time are provisional: they come from random Gaussians on an NVIDIA H100, not from training.
"""

from __future__ import annotations

_FEATURES = 16
"""Segmentation features of a Gaussian."""
_PAIRS = 3
"""Expected pairs of a tile and a Gaussian, per Gaussian, that the buffers hold; those of a new run hold 2."""
_ROOM = 1.25
"""Gaussians that the buffers have room for, per Gaussian: `GpuTrainer` grows them by a quarter more than is needed."""
_MAP_BYTES = 36
"""Bytes per pixel of the picture of the maps of the similarity."""
_LEVELS = 4 / 3
"""Pixels of a picture and all its halved copies, divided by those of the picture."""
_OWN_SHARE = 0.85
"""Share of the memory of a card that training may use; the driver and the screen need the rest."""
_SHARED_SHARE = 0.5
"""The same of the computer's free memory, where the card has none of its own: the process needs some too."""

_STEP_SECONDS = 1.3e-3
"""Seconds per step for submissions and random draws."""
_GAUSSIAN_SECONDS = 2.5e-9
_NUMBER_SECONDS = 0.03e-9
_PIXEL_SECONDS = 0.25e-9
_FEATURE_PIXEL_SECONDS = 0.2e-9
"""Seconds per step and Gaussian, number of a Gaussian, pixel, and pixel with features."""
_LARGE_MEMORY = 40 << 30
_SLOWDOWN, _SHARED_SLOWDOWN = 4.0, 30.0
"""Time on a separate card, and on one that uses the computer's memory, divided by that on a card of a data centre."""


def card_bytes(n_gaussians: int, *, sh_degree: int, features: bool, width: int, height: int, n_photos: int) -> int:
    """Return the bytes that training needs on a card.

    Parameters
    ----------
    features : bool
        Whether segmentation features are trained.
    width, height : int
        Size of the pictures.

    Notes
    -----
    With S coefficients of spherical harmonics for each colour, F features, K = 3 + F channels in C = K / 4 groups of
    four, rounded up, and 3 pairs of a tile and a Gaussian for each Gaussian:

    - a Gaussian: parameters, their activated values and moments 156 + 36 S + 16 F; projection, colours, sorting and
      gradients 156 + 32 C + 12 S; each pair 76 + 16 C; a quarter more for growth; with degree 3 and features 2.5 kB
    - a pixel of the picture: image 4 K, gradient 4 (K + 1), transmittance 12, and 36 for maps of the similarity, which
      lie where the gradients of the pairs are written later
    - a pixel of a photo: 4, and 4/3 of that with its smaller copies
    """
    n_pixels = width * height
    pair_gradients = n_gaussians * _pair_gradient_bytes(features)
    return int(
        n_gaussians * _bytes_per_gaussian(sh_degree, features)
        - pair_gradients
        + max(pair_gradients, _MAP_BYTES * n_pixels)
        + n_pixels * _bytes_per_pixel(features)
        + 4 * _LEVELS * n_photos * n_pixels
    )


def gaussians_that_fit(
    *,
    own_memory: int | None,
    free: int | None,
    max_buffer_bytes: int,
    sh_degree: int,
    features: bool,
    width: int,
    height: int,
    n_photos: int,
) -> int:
    """Return how many Gaussians a card holds in training beside the photos; 0 where it does not hold the photos.

    Parameters
    ----------
    own_memory, free : int or None
        Bytes of the card's own memory, and of the computer's free memory where the card uses that. If neither is known,
        only the largest buffer bounds the number.
    sh_degree, features, width, height, n_photos
        See `card_bytes`.
    """
    most = int(max_buffer_bytes / _pair_gradient_bytes(features))
    budgets = [_OWN_SHARE * own_memory] if own_memory is not None else []
    budgets += [_SHARED_SHARE * free] if free is not None else []
    fixed = card_bytes(
        0, sh_degree=sh_degree, features=features, width=width, height=height, n_photos=n_photos
    )  # fmt: skip
    rows = [int((budget - fixed) // _bytes_per_gaussian(sh_degree, features)) for budget in budgets]
    return max(0, min([most, *rows]))


def card_step_seconds(n_gaussians: int, n_pixels: int, *, sh_degree: int, features: bool) -> float:
    """Return the seconds of one training step on a card of a data centre.

    Notes
    -----
    1.3 ms + N (2.5 ns + 0.03 ns per number of a Gaussian) + 0.25 ns per pixel, 0.45 ns with features.
    """
    numbers = 11 + 3 * (sh_degree + 1) ** 2 + _FEATURES * features
    pixel = _PIXEL_SECONDS + _FEATURE_PIXEL_SECONDS * features
    return _STEP_SECONDS + n_gaussians * (_GAUSSIAN_SECONDS + _NUMBER_SECONDS * numbers) + n_pixels * pixel


def card_slowdown(own_memory: int | None, *, shares_memory: bool) -> float:
    """Return the factor on `card_step_seconds` for a kind of card. The first run on a card corrects it."""
    if shares_memory:
        return _SHARED_SLOWDOWN
    return 1.0 if (own_memory or 0) >= _LARGE_MEMORY else _SLOWDOWN


def _chunks(features: bool) -> int:
    return -(-(3 + _FEATURES * features) // 4)


def _pair_gradient_bytes(features: bool) -> float:
    """Return the bytes per Gaussian of the largest buffer, the gradients of each pair."""
    return _ROOM * _PAIRS * 16 * (_chunks(features) + 2)


def _bytes_per_gaussian(sh_degree: int, features: bool) -> float:
    n_sh, n_features, chunks = (sh_degree + 1) ** 2, _FEATURES * features, _chunks(features)
    parameters = 156 + 36 * n_sh + 16 * n_features
    return _ROOM * (parameters + 156 + 32 * chunks + 12 * n_sh + _PAIRS * (76 + 16 * chunks))


def _bytes_per_pixel(features: bool) -> int:
    channels = 3 + _FEATURES * features
    return 4 * channels + 4 * (channels + 1) + 12
