"""Sixteen float32 at a time, for kernels: loops over the channels of a row that don't hope for the compiler to find vectors.

Left to itself the compiler makes vectors of long rows only, and asks at each row anew whether arrays overlap. Here the same
source serves both: through a :func:`wide` pointer :func:`load` gives 16 numbers, through another one.
"""

# Numba has no types for mypy, and its compiler reads signatures from values.
# mypy: ignore-errors
from __future__ import annotations

import operator

from llvmlite import ir
from numba import types
from numba.extending import intrinsic, lower_builtin, models, register_model, type_callable

LANES = 16

FLOATS, HALVES = types.CPointer(types.float32), types.CPointer(types.uint16)
_FLAGS = ("contract", "nsz")
_WORD, _REAL = ir.IntType(32), ir.FloatType()


class _Vector(types.Type):
    def __init__(self):
        super().__init__(name="Vector16")


class _WidePointer(types.Type):
    """Leads to numbers of which 16 are taken at once."""

    def __init__(self, narrow):
        self.narrow = narrow
        super().__init__(name=f"Wide({narrow})")


VECTOR = _Vector()


@register_model(_Vector)
class _VectorModel(models.PrimitiveModel):
    def __init__(self, manager, kind):
        super().__init__(manager, kind, ir.VectorType(_REAL, LANES))


@register_model(_WidePointer)
class _WidePointerModel(models.PrimitiveModel):
    def __init__(self, manager, kind):
        element = ir.FloatType() if kind.narrow == FLOATS else ir.IntType(16)
        super().__init__(manager, kind, element.as_pointer())


@intrinsic
def wide(typing_context, pointer):
    """Return ``pointer``, to float32 or bfloat16, as one through which 16 numbers are read and written at once."""
    return _WidePointer(pointer)(pointer), lambda context, builder, signature, arguments: arguments[0]


def _place(builder, pointer, index, element):
    address = builder.gep(pointer, [index])
    return builder.bitcast(address, element.as_pointer())


def _like(count, element):
    return element if count == 1 else ir.VectorType(element, count)


def _constant(kind, value):
    return ir.Constant(kind, [value] * kind.count if isinstance(kind, ir.VectorType) else value)


def _is_wide(pointer):
    return isinstance(pointer, _WidePointer)


def _narrow(pointer):
    return pointer.narrow if _is_wide(pointer) else pointer


def _value_type(pointer):
    return VECTOR if _is_wide(pointer) else types.float32


@intrinsic
def load(typing_context, pointer, index):
    """Return the number, or the 16 numbers, at ``pointer[index]`` as float32."""
    count = LANES if _is_wide(pointer) else 1
    is_half = _narrow(pointer) == HALVES

    def generate(context, builder, signature, arguments):
        stored = ir.IntType(16) if is_half else _REAL
        place = _place(builder, *arguments, _like(count, stored))
        value = builder.load(place, align=2 if is_half else 4)
        if not is_half:
            return value
        # A bfloat16 is the upper half of a float32.
        words = _like(count, _WORD)
        return builder.bitcast(builder.shl(builder.zext(value, words), _constant(words, 16)), _like(count, _REAL))

    return _value_type(pointer)(pointer, types.int64), generate


@intrinsic
def store(typing_context, pointer, index, value):
    """Write ``value`` to ``pointer[index]``, rounded to the nearest (ties to even) where bfloat16 is kept there."""
    count = LANES if _is_wide(pointer) else 1
    is_half = _narrow(pointer) == HALVES

    def generate(context, builder, signature, arguments):
        pointer, index, value = arguments
        if is_half:
            words = _like(count, _WORD)
            word = builder.bitcast(value, words)
            odd = builder.and_(builder.lshr(word, _constant(words, 16)), _constant(words, 1))
            rounded = builder.add(builder.add(word, _constant(words, 0x7FFF)), odd)
            # Rounding could make infinity of what is not a number.
            is_none = builder.fcmp_unordered("uno", value, value)
            kept = builder.select(is_none, _constant(words, 0x7FC00000), rounded)
            value = builder.trunc(builder.lshr(kept, _constant(words, 16)), _like(count, ir.IntType(16)))
        builder.store(value, _place(builder, pointer, index, value.type), align=2 if is_half else 4)
        return context.get_dummy_value()

    return types.void(pointer, types.int64, _value_type(pointer)), generate


@intrinsic
def fetch_ahead(typing_context, pointer, index):
    """Have what lies at ``pointer[index]``, which may be outside of any memory, brought to the second cache."""

    def generate(context, builder, signature, arguments):
        byte = ir.IntType(8).as_pointer()
        kind = ir.FunctionType(ir.VoidType(), [byte, _WORD, _WORD, _WORD])
        place = builder.bitcast(builder.gep(arguments[0], [arguments[1]]), byte)
        to_read, locality, data = (ir.Constant(_WORD, code) for code in (0, 2, 1))
        builder.call(builder.module.declare_intrinsic("llvm.prefetch", (byte,), kind), [place, to_read, locality, data])
        return context.get_dummy_value()

    return types.void(pointer, types.int64), generate


@intrinsic
def nothing(typing_context, pointer):
    """Return 0, or 16 of them, as :func:`load` would through ``pointer``."""

    def generate(context, builder, signature, arguments):
        return _constant(_like(LANES if _is_wide(pointer) else 1, _REAL), 0.0)

    return _value_type(pointer)(pointer), generate


@intrinsic
def times(typing_context, factor, value):
    """Return the number ``factor`` times ``value``, one number or 16."""

    def generate(context, builder, signature, arguments):
        factor, value = arguments
        if isinstance(value.type, ir.VectorType):
            first = builder.insert_element(ir.Constant(value.type, ir.Undefined), factor, ir.Constant(_WORD, 0))
            mask = ir.Constant(ir.VectorType(_WORD, LANES), [0] * LANES)
            factor = builder.shuffle_vector(first, ir.Constant(value.type, ir.Undefined), mask)
        return builder.fmul(factor, value, flags=_FLAGS)

    return value(types.float32, value), generate


@intrinsic
def where_positive(typing_context, asked, value, slope):
    """Return ``value`` where ``asked`` is greater than 0, and ``slope`` times it elsewhere: LeakyReLU, and its derivative."""

    def generate(context, builder, signature, arguments):
        asked, value, slope = arguments
        if isinstance(value.type, ir.VectorType):
            first = builder.insert_element(ir.Constant(value.type, ir.Undefined), slope, ir.Constant(_WORD, 0))
            mask = ir.Constant(ir.VectorType(_WORD, LANES), [0] * LANES)
            slope = builder.shuffle_vector(first, ir.Constant(value.type, ir.Undefined), mask)
        is_positive = builder.fcmp_ordered(">", asked, _constant(asked.type, 0.0))
        return builder.select(is_positive, value, builder.fmul(slope, value))

    return value(value, value, types.float32), generate


def _define(symbol, name):
    @type_callable(symbol)
    def typed(context):
        def typer(left, right):
            return VECTOR if left == right == VECTOR else None

        return typer

    @lower_builtin(symbol, VECTOR, VECTOR)
    def lowered(context, builder, signature, arguments):
        return getattr(builder, name)(*arguments, flags=_FLAGS)


for _symbol, _name in ((operator.add, "fadd"), (operator.sub, "fsub"), (operator.mul, "fmul")):
    _define(_symbol, _name)
