"""Vectors of 16 float32 for Numba, as LLVM vectors, which LLVM compiles for SSE, AVX2, AVX-512 or NEON.

``Vec`` holds 16 floats, ``Mask`` 16 truth values. ``+ - * /`` and comparisons take two vectors, or a vector and a
float32, and are exactly one IEEE operation per lane. Only `fma` fuses operations, and nothing reorders them. Loads and
stores take one-dimensional float32 arrays of any alignment and check no bounds.
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
from .llvm import (
    I32,
    I64,
    LANES,
    V16B,
    V16F,
    V16I,
    broadcast,
    constant,
    element_pointer,
    fused_multiply_add,
    int_constant,
    load_unaligned,
    store_unaligned,
)

Vec = Any
"""Vector of 16 floats, in signatures. A type checker cannot describe Numba's type of it."""


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
        super().__init__(manager, fe_type, V16F)


@register_model(MaskType)
class _MaskModel(models.PrimitiveModel):
    def __init__(self, manager: Any, fe_type: Any) -> None:
        super().__init__(manager, fe_type, V16B)


_nodes = 0.5 * np.cos(np.pi * (np.arange(64) + 0.5) / 64)
_EXP2_POLYNOMIAL = [float(c) for c in np.polynomial.Polynomial.fit(_nodes, 2.0**_nodes, 5).convert().coef]
"""Coefficients of a polynomial of degree 5 for 2^f on |f| <= 1/2, fitted by least squares at Chebyshev nodes, which is
close to the best polynomial of that degree."""

# ---------------------------------------------------------------------------------------------- operators


def _register(op: Callable[..., Any], result: Any, emit: Callable[[Any, Any, Any], Any]) -> None:
    """Register `op` with Numba for (vec, vec), (vec, float32) and (float32, vec)."""
    pairs = [(vec, vec), (vec, types.float32), (types.float32, vec)]

    class Template(ConcreteTemplate):
        cases = [signature(result, *pair) for pair in pairs]

    infer_global(op)(Template)

    def lower(context: Any, builder: Any, sig: Any, args: Any) -> Any:
        a, b = (value if kind == vec else broadcast(builder, value) for kind, value in zip(sig.args, args, strict=True))
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
# Unordered: NaN differs from everything, so `x != y` detects it.
_register(operator.ne, mask, lambda builder, a, b: builder.fcmp_unordered("!=", a, b))


def _register_mask(op: Callable[..., Any], emit: Callable[[Any, Any, Any], Any]) -> None:
    """Register `op` with Numba for (mask, mask)."""

    class Template(ConcreteTemplate):
        cases = [signature(mask, mask, mask)]

    infer_global(op)(Template)
    lower_builtin(op, mask, mask)(lambda context, builder, sig, args: emit(builder, *args))


_register_mask(operator.and_, lambda builder, a, b: builder.and_(a, b))
_register_mask(operator.or_, lambda builder, a, b: builder.or_(a, b))


# ---------------------------------------------------------------------------------------------- loads and stores


@intrinsic
def splat(typing: Any, x: Any) -> Any:
    """Return the vector with float32 `x` in all lanes."""

    def emit(context: Any, builder: Any, sig: Any, args: Any) -> Any:
        return broadcast(builder, args[0])

    return vec(types.float32), emit


def lanes(values: Sequence[float]) -> Any:
    """Return an intrinsic without arguments that returns the constant vector of 16 `values`."""
    numbers = constant(values)

    @intrinsic
    def constant_lanes(typing: Any) -> Any:
        return vec(), lambda context, builder, sig, args: numbers

    return constant_lanes


@intrinsic
def load(typing: Any, array: Any, index: Any) -> Any:
    """Return ``array[index:index + 16]``."""

    def emit(context: Any, builder: Any, sig: Any, args: Any) -> Any:
        return load_unaligned(builder, element_pointer(context, builder, array, args[0], args[1], V16F))

    return vec(array, types.int64), emit


@intrinsic
def store(typing: Any, array: Any, index: Any, x: Any) -> Any:
    """Set ``array[index:index + 16] = x``."""

    def emit(context: Any, builder: Any, sig: Any, args: Any) -> Any:
        store_unaligned(builder, args[2], element_pointer(context, builder, array, args[0], args[1], V16F))
        return context.get_dummy_value()

    return types.void(array, types.int64, vec), emit


@intrinsic
def item(typing: Any, array: Any, index: Any) -> Any:
    """Return ``array[index]`` of a one-dimensional array without Numba's handling of negative indices."""

    def emit(context: Any, builder: Any, sig: Any, args: Any) -> Any:
        data = context.make_array(array)(context, builder, args[0]).data
        return builder.load(builder.gep(data, [args[1]]))

    return array.dtype(array, types.int64), emit


@intrinsic
def put(typing: Any, array: Any, index: Any, value: Any) -> Any:
    """Set ``array[index] = value`` of a one-dimensional array without Numba's handling of negative indices."""

    def emit(context: Any, builder: Any, sig: Any, args: Any) -> Any:
        data = context.make_array(array)(context, builder, args[0]).data
        builder.store(args[2], builder.gep(data, [args[1]]))
        return context.get_dummy_value()

    return types.void(array, types.int64, array.dtype), emit


@intrinsic
def prefetch(typing: Any, array: Any, index: Any) -> Any:
    """Prefetch ``array[index]`` of a one-dimensional array; the index may be out of bounds."""

    def emit(context: Any, builder: Any, sig: Any, args: Any) -> Any:
        data = context.make_array(array)(context, builder, args[0]).data
        pointer = builder.bitcast(builder.gep(data, [args[1]]), ir.IntType(8).as_pointer())
        kind = ir.FunctionType(ir.VoidType(), [pointer.type, I32, I32, I32])
        function = cgutils.get_or_insert_function(builder.module, kind, "llvm.prefetch.p0")
        builder.call(function, [pointer, *(ir.Constant(I32, value) for value in (0, 3, 1))])
        return context.get_dummy_value()

    return types.void(array, types.int64), emit


# ---------------------------------------------------------------------------------------------- arithmetic


@intrinsic
def fma(typing: Any, x: Any, y: Any, z: Any) -> Any:
    """Return x * y + z, rounded once; each argument is a vector or a float32."""

    def emit(context: Any, builder: Any, sig: Any, args: Any) -> Any:
        vectors = [a if kind == vec else broadcast(builder, a) for kind, a in zip(sig.args, args, strict=True)]
        return fused_multiply_add(builder, *vectors)

    return vec(*(vec if kind == vec else types.float32 for kind in (x, y, z))), emit


def _select_ordered(builder: Any, order: str, x: Any, y: Any) -> Any:
    """Return x where x `order` y, else y. It is one instruction; LLVM's own minimum takes three to handle NaN."""
    return builder.select(builder.fcmp_ordered(order, x, y), x, y)


def _ordered_intrinsic(order: str) -> Any:
    """Return an intrinsic of two vectors that returns x where x `order` y, else y."""

    @intrinsic
    def ordered(typing: Any, x: Any, y: Any) -> Any:
        return vec(vec, vec), lambda context, builder, sig, args: _select_ordered(builder, order, *args)

    return ordered


minimum = _ordered_intrinsic("<")
"""Return the smaller of x and y in each lane; `y` if one of them is NaN."""

maximum = _ordered_intrinsic(">")
"""Return the larger of x and y in each lane; `y` if one of them is NaN."""


def _minimum_by_bits(builder: Any, x: Any, limit: float) -> Any:
    """Return the smaller of `x`, which is nowhere negative, and `limit` in each lane; `limit` for NaN.

    The bits of such floats, read as integers, increase with their values, and processors have more units that compare
    integers than units that compare floats.
    """
    bits, limit_bits = builder.bitcast(x, V16I), builder.bitcast(constant(limit), V16I)
    smaller = builder.icmp_unsigned("<", bits, limit_bits)
    return builder.bitcast(builder.select(smaller, bits, limit_bits), V16F)


def minimum_with(limit: float) -> Any:
    """Return an intrinsic for the smaller of x, nowhere negative, and `limit` in each lane; `limit` for NaN."""

    @intrinsic
    def clamp(typing: Any, x: Any) -> Any:
        return vec(vec), lambda context, builder, sig, args: _minimum_by_bits(builder, args[0], limit)

    return clamp


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
        bits = builder.or_(builder.bitcast(args[0], V16I), int_constant(-(1 << 31)))
        return builder.bitcast(bits, V16F)

    return vec(vec), emit


@intrinsic
def exp2_negative(typing: Any, x: Any) -> Any:
    """Return 2^-x for x >= 0 with a relative error of at most 3e-7; for x above 100, 2^-100.

    -x = n - f with integer n and |f| <= 1/2. 2^-f is a polynomial of degree 5, and n is added to the exponent bits.
    """
    coefficients = [c * (-1) ** i for i, c in enumerate(_EXP2_POLYNOMIAL)]

    def emit(context: Any, builder: Any, sig: Any, args: Any) -> Any:
        x = _minimum_by_bits(builder, args[0], 100.0)
        # 1.5 * 2^23: subtracting x rounds x to an integer, which is then in the low bits of the mantissa.
        shift = constant(12582912.0)
        shifted = builder.fsub(shift, x)
        fraction = builder.fadd(x, builder.fsub(shifted, shift))
        power = constant(coefficients[-1])
        for coefficient in reversed(coefficients[:-1]):
            power = fused_multiply_add(builder, power, fraction, constant(coefficient))
        exponent = builder.shl(builder.bitcast(shifted, V16I), int_constant(23))
        return builder.bitcast(builder.add(builder.bitcast(power, V16I), exponent), V16F)

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
        return builder.zext(builder.bitcast(args[0], ir.IntType(LANES)), I64)

    return types.int64(mask), emit


@intrinsic
def load_bit(typing: Any, array: Any, index: Any, bit: Any) -> Any:
    """Return the mask of lanes where bit number `bit` of the integers ``array[index:index + 16]`` is set."""
    scalar = ir.IntType(array.dtype.bitwidth)
    wide = ir.VectorType(scalar, LANES)

    def emit(context: Any, builder: Any, sig: Any, args: Any) -> Any:
        pointer = element_pointer(context, builder, array, args[0], args[1], wide)
        values = load_unaligned(builder, pointer, scalar.width // 8)
        one_bit = builder.shl(ir.Constant(scalar, 1), context.cast(builder, args[2], sig.args[2], array.dtype))
        one_bit = broadcast(builder, one_bit)
        return builder.icmp_unsigned("!=", builder.and_(values, one_bit), ir.Constant(wide, None))

    return mask(array, types.int64, types.int64), emit


@intrinsic
def put_selected(typing: Any, array: Any, index: Any, first: Any, selected: Any) -> Any:
    """Write ``first + lane`` of each selected lane to int32 ``array[index:]`` without gaps; return how many there are.

    All of ``array[index:index + 16]`` is overwritten.
    """

    def emit(context: Any, builder: Any, sig: Any, args: Any) -> Any:
        base = broadcast(builder, context.cast(builder, args[2], sig.args[2], types.int32))
        numbers = builder.add(base, ir.Constant(V16I, list(range(LANES))))
        compress = cgutils.get_or_insert_function(
            builder.module, ir.FunctionType(V16I, [V16I, V16B, V16I]), "llvm.experimental.vector.compress.v16i32"
        )
        kept = builder.call(compress, [numbers, args[3], ir.Constant(V16I, ir.Undefined)])
        store_unaligned(builder, kept, element_pointer(context, builder, array, args[0], args[1], V16I))
        return builder.ctpop(builder.zext(builder.bitcast(args[3], ir.IntType(LANES)), I64))

    return types.int64(array, types.int64, types.int64, mask), emit
