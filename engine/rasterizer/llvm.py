"""LLVM types of the vectors of `simd`, and the LLVM instructions that several of its intrinsics emit."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from llvmlite import ir
from numba.core import cgutils

LANES = 16
"""Number of values in a vector: one AVX-512 register of float32, and the 4x4 pixels that are blended together. LLVM
splits it into smaller registers on other processors."""

F32 = ir.FloatType()
I1, I32, I64 = ir.IntType(1), ir.IntType(32), ir.IntType(64)
V16F, V16I, V16B = ir.VectorType(F32, LANES), ir.VectorType(I32, LANES), ir.VectorType(I1, LANES)
V4F = ir.VectorType(F32, 4)


def constant(values: float | Sequence[float]) -> ir.Constant:
    """Return the constant vector of 16 `values`, or of 16 times one value."""
    values = [values] * LANES if isinstance(values, int | float) else list(values)
    return ir.Constant(V16F, [ir.Constant(F32, float(value)) for value in values])


def int_constant(value: int) -> ir.Constant:
    """Return the constant vector of 16 times an int32."""
    return ir.Constant(V16I, [value] * LANES)


def broadcast(builder: Any, scalar: Any) -> Any:
    """Return the vector of 16 times a scalar of any type."""
    undefined = ir.Constant(ir.VectorType(scalar.type, LANES), ir.Undefined)
    first = builder.insert_element(undefined, scalar, ir.Constant(I32, 0))
    return builder.shuffle_vector(first, undefined, int_constant(0))


def shuffle(builder: Any, a: Any, b: Any, indices: Sequence[int]) -> Any:
    """Return the lanes `indices` of the concatenation of `a` and `b`."""
    pattern = ir.Constant(ir.VectorType(I32, len(indices)), [ir.Constant(I32, i) for i in indices])
    return builder.shuffle_vector(a, b, pattern)


def fused_multiply_add(builder: Any, x: Any, y: Any, z: Any) -> Any:
    """Return x * y + z of three vectors, rounded once."""
    function = cgutils.get_or_insert_function(builder.module, ir.FunctionType(V16F, [V16F] * 3), "llvm.fma.v16f32")
    return builder.call(function, [x, y, z])


def element_pointer(context: Any, builder: Any, array_type: Any, array: Any, index: Any, pointee: Any) -> Any:
    """Return a pointer of type `pointee` to element `index` of a one-dimensional array."""
    data = context.make_array(array_type)(context, builder, array).data
    return builder.bitcast(builder.gep(data, [index]), pointee.as_pointer())


def load_unaligned(builder: Any, pointer: Any, align: int = 4) -> Any:
    """Return the value at a pointer that is aligned to `align` bytes only."""
    loaded = builder.load(pointer)
    loaded.align = align
    return loaded


def store_unaligned(builder: Any, value: Any, pointer: Any) -> None:
    """Store `value` at a pointer that is aligned to 4 bytes only."""
    builder.store(value, pointer).align = 4
