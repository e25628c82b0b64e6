"""What the vectors of `simd` are made of: LLVM's types, and the few instructions that its intrinsics share."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from llvmlite import ir
from numba.core import cgutils

__all__ = [
    "F32",
    "I1",
    "I32",
    "I64",
    "LANES",
    "V16B",
    "V16F",
    "V16I",
    "V4F",
    "broadcast",
    "constant",
    "element",
    "fused",
    "int_constant",
    "load_unaligned",
    "shuffle",
    "store_unaligned",
]

LANES = 16
F32 = ir.FloatType()
I1, I32, I64 = ir.IntType(1), ir.IntType(32), ir.IntType(64)
V16F, V16I, V16B = ir.VectorType(F32, LANES), ir.VectorType(I32, LANES), ir.VectorType(I1, LANES)
V4F = ir.VectorType(F32, 4)


def constant(values: float | Sequence[float]) -> ir.Constant:
    """Return 16 floats, all the same when one is given."""
    values = [values] * LANES if isinstance(values, int | float) else list(values)
    return ir.Constant(V16F, [ir.Constant(F32, float(value)) for value in values])


def int_constant(value: int) -> ir.Constant:
    """Return 16 times an int32."""
    return ir.Constant(V16I, [value] * LANES)


def broadcast(builder: Any, scalar: Any) -> Any:
    """Return 16 times a value of any type."""
    undefined = ir.Constant(ir.VectorType(scalar.type, LANES), ir.Undefined)
    first = builder.insert_element(undefined, scalar, ir.Constant(I32, 0))
    return builder.shuffle_vector(first, undefined, int_constant(0))


def shuffle(builder: Any, a: Any, b: Any, indices: Sequence[int]) -> Any:
    """Return the lanes `indices` of `a` followed by `b`."""
    pattern = ir.Constant(ir.VectorType(I32, len(indices)), [ir.Constant(I32, i) for i in indices])
    return builder.shuffle_vector(a, b, pattern)


def fused(builder: Any, x: Any, y: Any, z: Any) -> Any:
    """Return x * y + z, rounded once."""
    function = cgutils.get_or_insert_function(builder.module, ir.FunctionType(V16F, [V16F] * 3), "llvm.fma.v16f32")
    return builder.call(function, [x, y, z])


def element(context: Any, builder: Any, array_type: Any, array: Any, index: Any, pointee: Any) -> Any:
    """Return a pointer of type `pointee` to element `index` of a one-dimensional array."""
    data = context.make_array(array_type)(context, builder, array).data
    return builder.bitcast(builder.gep(data, [index]), pointee.as_pointer())


def load_unaligned(builder: Any, pointer: Any, align: int = 4) -> Any:
    """Return what lies at a pointer that is a multiple of `align` bytes at best."""
    loaded = builder.load(pointer)
    loaded.align = align
    return loaded


def store_unaligned(builder: Any, value: Any, pointer: Any) -> None:
    """Put `value` at a pointer that is a multiple of 4 bytes at best."""
    builder.store(value, pointer).align = 4
