"""Sixteen float32 at a time for Numba, written as LLVM vectors; LLVM fits them to SSE, AVX2, AVX-512 or NEON.

``Vec`` holds 16 floats, ``Mask`` 16 truth values. ``+ - * /`` and comparisons work on vectors and on a vector with a
float32, and mean exactly one IEEE operation each: nothing is fused or re-ordered but by `fma`. Loads and stores take
one-dimensional float32 arrays, any alignment, and check no bounds.
"""

from __future__ import annotations

import operator
from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
from llvmlite import ir
from numba.core import cgutils, types
from numba.core.datamodel import models
from numba.core.typing.templates import ConcreteTemplate, infer_global, signature
from numba.extending import intrinsic, lower_builtin, register_model

from . import jit  # noqa: F401  (sets the cache folder before the first kernel is decorated)

__all__ = [
    "Vec",
    "all_bits",
    "any_of",
    "exp2_nonpositive",
    "fma",
    "item",
    "lanes",
    "load",
    "load_bit",
    "load_pixels4",
    "maximum",
    "minimum",
    "negative",
    "negative_abs",
    "prefetch",
    "put",
    "put_chosen",
    "select",
    "splat",
    "store",
    "store_pixels4",
    "store_sums4",
]

Vec = Any
"""Sixteen floats in the signature of a kernel's helper: what a checker of types outside of Numba can say of them."""

LANES = 16
_F = ir.FloatType()
_I1, _I32, _I64 = ir.IntType(1), ir.IntType(32), ir.IntType(64)
_VF, _VI, _VB = ir.VectorType(_F, LANES), ir.VectorType(_I32, LANES), ir.VectorType(_I1, LANES)
_V4 = ir.VectorType(_F, 4)


class VecType(types.Type):
    """Numba type of 16 floats."""

    def __init__(self) -> None:
        super().__init__(name="Vec16")


class MaskType(types.Type):
    """Numba type of 16 truth values."""

    def __init__(self) -> None:
        super().__init__(name="Mask16")


vec, mask = VecType(), MaskType()


@register_model(VecType)
class _VecModel(models.PrimitiveModel):
    def __init__(self, manager: Any, fe_type: Any) -> None:
        super().__init__(manager, fe_type, _VF)


@register_model(MaskType)
class _MaskModel(models.PrimitiveModel):
    def __init__(self, manager: Any, fe_type: Any) -> None:
        super().__init__(manager, fe_type, _VB)


_nodes = 0.5 * np.cos(np.pi * (np.arange(64) + 0.5) / 64)
_EXP2_POLYNOMIAL = [float(c) for c in np.polynomial.Polynomial.fit(_nodes, 2.0**_nodes, 5).convert().coef]
"""2^f on |f| <= 1/2: least squares at Chebyshev nodes, all but the best polynomial of degree 5."""

# ---------------------------------------------------------------------------------------------- LLVM helpers


def _constant(values: float | Sequence[float]) -> ir.Constant:
    values = [values] * LANES if isinstance(values, int | float) else list(values)
    return ir.Constant(_VF, [ir.Constant(_F, float(value)) for value in values])


def _int_constant(value: int) -> ir.Constant:
    return ir.Constant(_VI, [value] * LANES)


def _broadcast(builder: Any, scalar: Any) -> Any:
    undefined = ir.Constant(_VF, ir.Undefined)
    first = builder.insert_element(undefined, scalar, ir.Constant(_I32, 0))
    return builder.shuffle_vector(first, undefined, _int_constant(0))


def _shuffle(builder: Any, a: Any, b: Any, indices: Sequence[int]) -> Any:
    pattern = ir.Constant(ir.VectorType(_I32, len(indices)), [ir.Constant(_I32, i) for i in indices])
    return builder.shuffle_vector(a, b, pattern)


def _fma(builder: Any, x: Any, y: Any, z: Any) -> Any:
    function = cgutils.get_or_insert_function(builder.module, ir.FunctionType(_VF, [_VF] * 3), "llvm.fma.v16f32")
    return builder.call(function, [x, y, z])


def _element(context: Any, builder: Any, array_type: Any, array: Any, index: Any, pointee: Any) -> Any:
    """Return a pointer of type `pointee` to element `index` of a one-dimensional array."""
    data = context.make_array(array_type)(context, builder, array).data
    return builder.bitcast(builder.gep(data, [index]), pointee.as_pointer())


def _load_unaligned(builder: Any, pointer: Any) -> Any:
    loaded = builder.load(pointer)
    loaded.align = 4
    return loaded


def _store_unaligned(builder: Any, value: Any, pointer: Any) -> None:
    builder.store(value, pointer).align = 4


# ---------------------------------------------------------------------------------------------- operators


def _register(op: Callable[..., Any], result: Any, emit: Callable[[Any, Any, Any], Any]) -> None:
    """Teach Numba `op` on (vec, vec), (vec, float32) and (float32, vec)."""
    pairs = [(vec, vec), (vec, types.float32), (types.float32, vec)]

    class Template(ConcreteTemplate):
        cases = [signature(result, *pair) for pair in pairs]

    infer_global(op)(Template)

    def lower(context: Any, builder: Any, sig: Any, args: Any) -> Any:
        a, b = (
            value if kind == vec else _broadcast(builder, value) for kind, value in zip(sig.args, args, strict=True)
        )
        return emit(builder, a, b)

    for pair in pairs:
        lower_builtin(op, *pair)(lower)


_register(operator.add, vec, lambda builder, a, b: builder.fadd(a, b))
_register(operator.sub, vec, lambda builder, a, b: builder.fsub(a, b))
_register(operator.mul, vec, lambda builder, a, b: builder.fmul(a, b))
_register(operator.truediv, vec, lambda builder, a, b: builder.fdiv(a, b))
_register(operator.lt, mask, lambda builder, a, b: builder.fcmp_ordered("<", a, b))
_register(operator.le, mask, lambda builder, a, b: builder.fcmp_ordered("<=", a, b))
_register(operator.gt, mask, lambda builder, a, b: builder.fcmp_ordered(">", a, b))
_register(operator.ge, mask, lambda builder, a, b: builder.fcmp_ordered(">=", a, b))
# Unordered: a NaN differs from everything, so that it is noticed.
_register(operator.ne, mask, lambda builder, a, b: builder.fcmp_unordered("!=", a, b))


def _register_mask(op: Callable[..., Any], emit: Callable[[Any, Any, Any], Any]) -> None:
    """Teach Numba `op` on (mask, mask)."""

    class Template(ConcreteTemplate):
        cases = [signature(mask, mask, mask)]

    infer_global(op)(Template)
    lower_builtin(op, mask, mask)(lambda context, builder, sig, args: emit(builder, *args))


_register_mask(operator.and_, lambda builder, a, b: builder.and_(a, b))
_register_mask(operator.or_, lambda builder, a, b: builder.or_(a, b))


# ---------------------------------------------------------------------------------------------- making and moving


@intrinsic
def splat(typing: Any, x: Any) -> Any:
    """Return the vector that holds float32 `x` in all lanes."""

    def emit(context: Any, builder: Any, sig: Any, args: Any) -> Any:
        return _broadcast(builder, args[0])

    return vec(types.float32), emit


def lanes(values: Sequence[float]) -> Any:
    """Return an intrinsic without arguments that gives the constant vector of 16 `values`."""
    constant = _constant(values)

    @intrinsic
    def constant_lanes(typing: Any) -> Any:
        return vec(), lambda context, builder, sig, args: constant

    return constant_lanes


@intrinsic
def load(typing: Any, array: Any, index: Any) -> Any:
    """Return ``array[index:index + 16]``."""

    def emit(context: Any, builder: Any, sig: Any, args: Any) -> Any:
        return _load_unaligned(builder, _element(context, builder, array, args[0], args[1], _VF))

    return vec(array, types.int64), emit


@intrinsic
def store(typing: Any, array: Any, index: Any, x: Any) -> Any:
    """Set ``array[index:index + 16] = x``."""

    def emit(context: Any, builder: Any, sig: Any, args: Any) -> Any:
        _store_unaligned(builder, args[2], _element(context, builder, array, args[0], args[1], _VF))
        return context.get_dummy_value()

    return types.void(array, types.int64, vec), emit


@intrinsic
def item(typing: Any, array: Any, index: Any) -> Any:
    """Return ``array[index]`` of a one-dimensional array, an index below zero not being allowed."""

    def emit(context: Any, builder: Any, sig: Any, args: Any) -> Any:
        data = context.make_array(array)(context, builder, args[0]).data
        return builder.load(builder.gep(data, [args[1]]))

    return array.dtype(array, types.int64), emit


@intrinsic
def put(typing: Any, array: Any, index: Any, value: Any) -> Any:
    """Set ``array[index] = value`` of a one-dimensional array, an index below zero not being allowed."""

    def emit(context: Any, builder: Any, sig: Any, args: Any) -> Any:
        data = context.make_array(array)(context, builder, args[0]).data
        builder.store(args[2], builder.gep(data, [args[1]]))
        return context.get_dummy_value()

    return types.void(array, types.int64, array.dtype), emit


@intrinsic
def prefetch(typing: Any, array: Any, index: Any) -> Any:
    """Ask for the flat ``array[index]`` before it is read or written; any index may be asked for."""

    def emit(context: Any, builder: Any, sig: Any, args: Any) -> Any:
        data = context.make_array(array)(context, builder, args[0]).data
        place = builder.bitcast(builder.gep(data, [args[1]]), ir.IntType(8).as_pointer())
        kind = ir.FunctionType(ir.VoidType(), [place.type, _I32, _I32, _I32])
        ask = cgutils.get_or_insert_function(builder.module, kind, "llvm.prefetch.p0")
        builder.call(ask, [place, *(ir.Constant(_I32, value) for value in (0, 3, 1))])
        return context.get_dummy_value()

    return types.void(array, types.int64), emit


# ---------------------------------------------------------------------------------------------- arithmetic


@intrinsic
def fma(typing: Any, x: Any, y: Any, z: Any) -> Any:
    """Return x * y + z, rounded once."""

    def emit(context: Any, builder: Any, sig: Any, args: Any) -> Any:
        wide = [a if kind == vec else _broadcast(builder, a) for kind, a in zip(sig.args, args, strict=True)]
        return _fma(builder, *wide)

    return vec(*(vec if kind == vec else types.float32 for kind in (x, y, z))), emit


def _pick(builder: Any, order: str, x: Any, y: Any) -> Any:
    """Return x where x `order` y, else y, which is one instruction; unlike IEEE's, two more of which see to a NaN in y."""
    return builder.select(builder.fcmp_ordered(order, x, y), x, y)


def _two(order: str) -> Any:
    @intrinsic
    def two(typing: Any, x: Any, y: Any) -> Any:
        return vec(vec, vec), lambda context, builder, sig, args: _pick(builder, order, *args)

    return two


minimum = _two("<")
"""The lesser; `y` where one is NaN."""

maximum = _two(">")
"""The greater; `y` where one is NaN."""


@intrinsic
def select(typing: Any, condition: Any, x: Any, y: Any) -> Any:
    """Return x where `condition`, else y."""

    def emit(context: Any, builder: Any, sig: Any, args: Any) -> Any:
        return builder.select(*args)

    return vec(mask, vec, vec), emit


@intrinsic
def negative(typing: Any, x: Any) -> Any:
    """Return -x by flipping the sign bit; ``fma(negative(x), y, z)`` is one instruction."""

    def emit(context: Any, builder: Any, sig: Any, args: Any) -> Any:
        return builder.fneg(args[0])

    return vec(vec), emit


@intrinsic
def negative_abs(typing: Any, x: Any) -> Any:
    """Return -|x| by setting the sign bit."""

    def emit(context: Any, builder: Any, sig: Any, args: Any) -> Any:
        bits = builder.or_(builder.bitcast(args[0], _VI), _int_constant(-(1 << 31)))
        return builder.bitcast(bits, _VF)

    return vec(vec), emit


@intrinsic
def exp2_nonpositive(typing: Any, x: Any) -> Any:
    """Return 2^x for x <= 0, within 3e-7 relative; below -100 it stays at 2^-100.

    x = n + f with integer n and |f| <= 1/2; 2^f is a polynomial of degree 5 and n is added to the exponent bits.
    """
    coefficients = _EXP2_POLYNOMIAL

    def emit(context: Any, builder: Any, sig: Any, args: Any) -> Any:
        x = _pick(builder, ">", args[0], _constant(-100.0))
        shift = _constant(12582912.0)  # 1.5 * 2^23: adding it rounds to an integer, left in the low mantissa bits
        shifted = builder.fadd(x, shift)
        fraction = builder.fsub(x, builder.fsub(shifted, shift))
        power = _constant(coefficients[-1])
        for coefficient in reversed(coefficients[:-1]):
            power = _fma(builder, power, fraction, _constant(coefficient))
        exponent = builder.shl(builder.bitcast(shifted, _VI), _int_constant(23))
        return builder.bitcast(builder.add(builder.bitcast(power, _VI), exponent), _VF)

    return vec(vec), emit


# ---------------------------------------------------------------------------------------------- masks and bits


@intrinsic
def any_of(typing: Any, condition: Any) -> Any:
    """Return whether any lane is true."""

    def emit(context: Any, builder: Any, sig: Any, args: Any) -> Any:
        bits = builder.bitcast(args[0], ir.IntType(LANES))
        return builder.icmp_unsigned("!=", bits, ir.Constant(bits.type, 0))

    return types.boolean(mask), emit


@intrinsic
def all_bits(typing: Any, condition: Any) -> Any:
    """Return the truth values as the 16 low bits of an int64, lane 0 lowest."""

    def emit(context: Any, builder: Any, sig: Any, args: Any) -> Any:
        return builder.zext(builder.bitcast(args[0], ir.IntType(LANES)), _I64)

    return types.int64(mask), emit


@intrinsic
def load_bit(typing: Any, array: Any, index: Any, bit: Any) -> Any:
    """Return in which of the 16 integers ``array[index:index + 16]`` bit number `bit` is set."""
    scalar = ir.IntType(array.dtype.bitwidth)
    wide = ir.VectorType(scalar, LANES)

    def emit(context: Any, builder: Any, sig: Any, args: Any) -> Any:
        values = _load_unaligned(builder, _element(context, builder, array, args[0], args[1], wide))
        wanted = builder.shl(ir.Constant(scalar, 1), context.cast(builder, args[2], sig.args[2], array.dtype))
        undefined = ir.Constant(wide, ir.Undefined)
        first = builder.insert_element(undefined, wanted, ir.Constant(_I32, 0))
        wanted = builder.shuffle_vector(first, undefined, _int_constant(0))
        return builder.icmp_unsigned("!=", builder.and_(values, wanted), ir.Constant(wide, None))

    return mask(array, types.int64, types.int64), emit


@intrinsic
def put_chosen(typing: Any, array: Any, index: Any, first: Any, chosen: Any) -> Any:
    """Write ``first + lane`` of each true lane to int32 ``array[index:]``, side by side, and return how many.

    All of ``array[index:index + 16]`` is written.
    """

    def emit(context: Any, builder: Any, sig: Any, args: Any) -> Any:
        base = context.cast(builder, args[2], sig.args[2], types.int32)
        undefined = ir.Constant(_VI, ir.Undefined)
        wide = builder.shuffle_vector(
            builder.insert_element(undefined, base, ir.Constant(_I32, 0)), undefined, _int_constant(0)
        )
        numbers = builder.add(wide, ir.Constant(_VI, list(range(LANES))))
        compress = cgutils.get_or_insert_function(
            builder.module, ir.FunctionType(_VI, [_VI, _VB, _VI]), "llvm.experimental.vector.compress.v16i32"
        )
        kept = builder.call(compress, [numbers, args[3], undefined])
        _store_unaligned(builder, kept, _element(context, builder, array, args[0], args[1], _VI))
        return builder.ctpop(builder.zext(builder.bitcast(args[3], ir.IntType(LANES)), _I64))

    return types.int64(array, types.int64, types.int64, mask), emit


# ---------------------------------------------------------------------------------------------- sums and transposes


def _transpose4(builder: Any, rows: Sequence[Any]) -> list[Any]:
    """Transpose the 4x4 matrices that lie in each group of 4 lanes of four vectors (1 or 4 groups)."""
    n = rows[0].type.count

    def pick(a: Any, b: Any, pattern: Sequence[tuple[int, int]]) -> Any:
        return _shuffle(builder, a, b, [side * n + group + lane for group in range(0, n, 4) for side, lane in pattern])

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
        def folded(x: Any, y: Any, width: int) -> Any:
            """Add the halves of each group of `2 width` lanes: those of `x` become the first half, those of `y` follow."""
            groups = range(0, 2 * LANES, 2 * width)
            near, far = ([at + half + lane for at in groups for lane in range(width)] for half in (0, width))
            return builder.fadd(_shuffle(builder, x, y, near), _shuffle(builder, x, y, far))

        a, b, c, d = args[2:]
        fours = folded(folded(a, b, 8), folded(c, d, 8), 4)
        for distance in (1, 2):
            fours = builder.fadd(fours, _shuffle(builder, fours, fours, [lane ^ distance for lane in range(LANES)]))
        total = _shuffle(builder, fours, fours, [0, 4, 8, 12])
        _store_unaligned(builder, total, _element(context, builder, array, args[0], args[1], _V4))
        return context.get_dummy_value()

    return types.void(array, types.int64, vec, vec, vec, vec), emit


@intrinsic
def load_pixels4(typing: Any, image: Any, start: Any, row_step: Any, pixel_step: Any, planes: Any, at: Any) -> Any:
    """Copy 4 neighbouring channels of a 4x4 block of pixels into 4 vectors, one a channel, at ``planes[at:at + 64]``.

    `start` is the index of the block's first value in the flat `image`; `row_step` and `pixel_step` count floats.
    """

    def emit(context: Any, builder: Any, sig: Any, args: Any) -> Any:
        image_value, start_value, row_value, pixel_value, planes_value, at_value = args
        pixels = []
        for y in range(4):
            for x in range(4):
                index = builder.add(
                    start_value,
                    builder.add(
                        builder.mul(row_value, ir.Constant(_I64, y)), builder.mul(pixel_value, ir.Constant(_I64, x))
                    ),
                )
                pixels.append(_load_unaligned(builder, _element(context, builder, image, image_value, index, _V4)))
        columns = []
        for x in range(4):  # column x of the block, its four rows one after another
            upper = _shuffle(builder, pixels[x], pixels[x + 4], list(range(8)))
            lower = _shuffle(builder, pixels[x + 8], pixels[x + 12], list(range(8)))
            columns.append(_shuffle(builder, upper, lower, list(range(16))))
        for channel, values in enumerate(_transpose4(builder, columns)):
            index = builder.add(at_value, ir.Constant(_I64, channel * LANES))
            _store_unaligned(builder, values, _element(context, builder, planes, planes_value, index, _VF))
        return context.get_dummy_value()

    return types.void(image, types.int64, types.int64, types.int64, planes, types.int64), emit


@intrinsic
def store_pixels4(
    typing: Any, image: Any, start: Any, row_step: Any, pixel_step: Any, a: Any, b: Any, c: Any, d: Any
) -> Any:
    """Write 4 vectors, one a channel, to 4 neighbouring channels of a 4x4 block of pixels: `load_pixels4` undone."""

    def emit(context: Any, builder: Any, sig: Any, args: Any) -> Any:
        image_value, start_value, row_value, pixel_value = args[:4]
        columns = _transpose4(builder, args[4:])
        for y in range(4):
            for x in range(4):
                index = builder.add(
                    start_value,
                    builder.add(
                        builder.mul(row_value, ir.Constant(_I64, y)), builder.mul(pixel_value, ir.Constant(_I64, x))
                    ),
                )
                pixel = _shuffle(builder, columns[x], columns[x], [4 * y + k for k in range(4)])
                _store_unaligned(builder, pixel, _element(context, builder, image, image_value, index, _V4))
        return context.get_dummy_value()

    return types.void(image, types.int64, types.int64, types.int64, vec, vec, vec, vec), emit
