"""Operations across the lanes of vectors: sums, and copies of 4x4 blocks of pixels.

An image stores the channels of a pixel next to each other; a vector holds one channel of a block.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import Any

from llvmlite import ir
from numba.core import types
from numba.extending import intrinsic

from .llvm import I64, LANES, V4F, V16F, element_pointer, load_unaligned, shuffle, store_unaligned
from .simd import vec


def _transpose4(builder: Any, rows: Sequence[Any]) -> list[Any]:
    """Transpose the 4x4 matrix that each group of 4 lanes of four vectors forms (1 or 4 groups)."""
    n = rows[0].type.count

    def pick(a: Any, b: Any, pattern: Sequence[tuple[int, int]]) -> Any:
        return shuffle(builder, a, b, [side * n + group + lane for group in range(0, n, 4) for side, lane in pattern])

    low, high = [(0, 0), (1, 0), (0, 1), (1, 1)], [(0, 2), (1, 2), (0, 3), (1, 3)]
    ab_low, ab_high = pick(rows[0], rows[1], low), pick(rows[0], rows[1], high)
    cd_low, cd_high = pick(rows[2], rows[3], low), pick(rows[2], rows[3], high)
    first, second = [(0, 0), (0, 1), (1, 0), (1, 1)], [(0, 2), (0, 3), (1, 2), (1, 3)]
    return [
        pick(ab_low, cd_low, first),
        pick(ab_low, cd_low, second),
        pick(ab_high, cd_high, first),
        pick(ab_high, cd_high, second),
    ]


@intrinsic
def store_sums4(typing: Any, array: Any, index: Any, a: Any, b: Any, c: Any, d: Any) -> Any:
    """Set ``array[index:index + 4]`` to the sums over the lanes of four vectors."""

    def emit(context: Any, builder: Any, sig: Any, args: Any) -> Any:
        def fold(x: Any, y: Any, width: int) -> Any:
            """Add the halves of each group of `2 width` lanes; the sums of `x` come first, those of `y` follow."""
            groups = range(0, 2 * LANES, 2 * width)
            first, second = ([at + half + lane for at in groups for lane in range(width)] for half in (0, width))
            return builder.fadd(shuffle(builder, x, y, first), shuffle(builder, x, y, second))

        a, b, c, d = args[2:]
        sums = fold(fold(a, b, 8), fold(c, d, 8), 4)
        for distance in (1, 2):
            sums = builder.fadd(sums, shuffle(builder, sums, sums, [lane ^ distance for lane in range(LANES)]))
        total = shuffle(builder, sums, sums, [0, 4, 8, 12])
        store_unaligned(builder, total, element_pointer(context, builder, array, args[0], args[1], V4F))
        return context.get_dummy_value()

    return types.void(array, types.int64, vec, vec, vec, vec), emit


def _pixels(
    context: Any, builder: Any, image_type: Any, image: Any, start: Any, row_step: Any, pixel_step: Any
) -> Iterator[Any]:
    """Yield pointers to 4 channels of each pixel of a 4x4 block, row by row; arguments as in `load_pixels4`."""
    for y in range(4):
        for x in range(4):
            offset = builder.add(
                builder.mul(row_step, ir.Constant(I64, y)), builder.mul(pixel_step, ir.Constant(I64, x))
            )
            yield element_pointer(context, builder, image_type, image, builder.add(start, offset), V4F)


@intrinsic
def load_pixels4(typing: Any, image: Any, start: Any, row_step: Any, pixel_step: Any, planes: Any, at: Any) -> Any:
    """Copy 4 neighbouring channels of a 4x4 block of pixels to 4 vectors, one per channel, at ``planes[at:at + 64]``.

    `start` is the index of the block's first value in the flat `image`; `row_step` and `pixel_step` count floats.
    """

    def emit(context: Any, builder: Any, sig: Any, args: Any) -> Any:
        planes_value, at_value = args[4:]
        pixels = [load_unaligned(builder, pointer) for pointer in _pixels(context, builder, image, *args[:4])]
        columns = []
        for x in range(4):  # Column x of the block: its four rows, one after another.
            upper = shuffle(builder, pixels[x], pixels[x + 4], list(range(8)))
            lower = shuffle(builder, pixels[x + 8], pixels[x + 12], list(range(8)))
            columns.append(shuffle(builder, upper, lower, list(range(16))))
        for channel, values in enumerate(_transpose4(builder, columns)):
            index = builder.add(at_value, ir.Constant(I64, channel * LANES))
            store_unaligned(builder, values, element_pointer(context, builder, planes, planes_value, index, V16F))
        return context.get_dummy_value()

    return types.void(image, types.int64, types.int64, types.int64, planes, types.int64), emit


@intrinsic
def store_pixels4(
    typing: Any, image: Any, start: Any, row_step: Any, pixel_step: Any, a: Any, b: Any, c: Any, d: Any
) -> Any:
    """Copy 4 vectors, one per channel, to 4 neighbouring channels of a 4x4 block: the inverse of `load_pixels4`."""

    def emit(context: Any, builder: Any, sig: Any, args: Any) -> Any:
        columns = _transpose4(builder, args[4:])
        for i, pointer in enumerate(_pixels(context, builder, image, *args[:4])):
            y, x = divmod(i, 4)
            pixel = shuffle(builder, columns[x], columns[x], [4 * y + k for k in range(4)])
            store_unaligned(builder, pixel, pointer)
        return context.get_dummy_value()

    return types.void(image, types.int64, types.int64, types.int64, vec, vec, vec, vec), emit
