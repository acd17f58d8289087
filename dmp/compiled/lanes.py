"""Four float32 at a time, for kernels: three coordinates and one number more, or the same number of four faces.

A vertex or a face that is gathered is one load of four numbers; turned (:func:`turned`), four of them are computed with at
once. Every processor of the last twenty years has registers for four.
"""

# Numba has no types for mypy, and its compiler reads signatures from values.
# mypy: ignore-errors
from __future__ import annotations

import operator

import numpy as np
from llvmlite import ir
from numba import njit, types
from numba.extending import intrinsic, lower_builtin, models, register_model, type_callable

from dmp.compiled.pointers import OPTIONS

LANES = 4

# Calls cost more than what is done with four numbers.
inlined = njit(forceinline=True, **OPTIONS)

_FLAGS = ("contract", "nsz")
_REAL, _WORD = ir.FloatType(), ir.IntType(32)
_FOUR = ir.VectorType(_REAL, LANES)
_UNDEFINED = ir.Constant(_FOUR, ir.Undefined)


class _Four(types.Type):
    def __init__(self):
        super().__init__(name="Four")


FOUR = _Four()


@register_model(_Four)
class _FourModel(models.PrimitiveModel):
    def __init__(self, manager, kind):
        super().__init__(manager, kind, _FOUR)


def _define(symbol, name):
    @type_callable(symbol)
    def typed(context):
        def typer(left, right):
            return FOUR if left == right == FOUR else None

        return typer

    @lower_builtin(symbol, FOUR, FOUR)
    def lowered(context, builder, signature, arguments):
        return getattr(builder, name)(*arguments, flags=_FLAGS)


for _symbol, _name in ((operator.add, "fadd"), (operator.sub, "fsub"), (operator.mul, "fmul"), (operator.truediv, "fdiv")):
    _define(_symbol, _name)


@intrinsic
def load4(typing_context, pointer, index):
    """Return the four numbers from ``pointer[index]`` on."""

    def generate(context, builder, signature, arguments):
        place = builder.bitcast(builder.gep(arguments[0], [arguments[1]]), _FOUR.as_pointer())
        return builder.load(place, align=4)

    return FOUR(pointer, types.int64), generate


@intrinsic
def store4(typing_context, pointer, index, value):
    """Write four numbers from ``pointer[index]`` on."""

    def generate(context, builder, signature, arguments):
        place = builder.bitcast(builder.gep(arguments[0], [arguments[1]]), _FOUR.as_pointer())
        builder.store(arguments[2], place, align=4)
        return context.get_dummy_value()

    return types.void(pointer, types.int64, FOUR), generate


@intrinsic
def all4(typing_context, number):
    """Return four times the same float32."""

    def generate(context, builder, signature, arguments):
        first = builder.insert_element(_UNDEFINED, arguments[0], ir.Constant(_WORD, 0))
        return builder.shuffle_vector(first, _UNDEFINED, ir.Constant(ir.VectorType(_WORD, LANES), [0] * LANES))

    return FOUR(types.float32), generate


@intrinsic
def square_root(typing_context, value):
    """Return the square roots."""

    def generate(context, builder, signature, arguments):
        name, module = "llvm.sqrt.v4f32", builder.module
        function = module.globals.get(name) or ir.Function(module, ir.FunctionType(_FOUR, [_FOUR]), name)
        return builder.call(function, arguments)

    return FOUR(FOUR), generate


@intrinsic
def larger(typing_context, left, right):
    """Return the larger number of each pair."""

    def generate(context, builder, signature, arguments):
        left, right = arguments
        return builder.select(builder.fcmp_ordered(">", left, right), left, right)

    return FOUR(FOUR, FOUR), generate


@intrinsic
def where_larger(typing_context, left, right, chosen, other):
    """Return ``chosen`` where ``left`` is larger than ``right``, and ``other`` elsewhere."""

    def generate(context, builder, signature, arguments):
        left, right, chosen, other = arguments
        return builder.select(builder.fcmp_ordered(">", left, right), chosen, other)

    return FOUR(FOUR, FOUR, FOUR, FOUR), generate


def _arranging(places):
    @intrinsic
    def arranged(typing_context, left, right):
        def generate(context, builder, signature, arguments):
            return builder.shuffle_vector(*arguments, ir.Constant(ir.VectorType(_WORD, LANES), places))

        return FOUR(FOUR, FOUR), generate

    return arranged


# Places 0 to 3 are those of the first value, 4 to 7 those of the second.
_firsts, _seconds = _arranging([0, 4, 1, 5]), _arranging([2, 6, 3, 7])
_lower, _upper = _arranging([0, 1, 4, 5]), _arranging([2, 3, 6, 7])
_all_of_0, _all_of_1, _all_of_2, _all_of_3 = (_arranging([place] * LANES) for place in range(LANES))
# Three coordinates of the first value, then one number of the second.
_with_0, _with_1, _with_2, _with_3 = (_arranging([0, 1, 2, LANES + place]) for place in range(LANES))


@inlined
def turned(a, b, c, d):
    """Return the four columns of a matrix with the rows a, b, c, d."""
    p, q, r, s = _firsts(a, b), _firsts(c, d), _seconds(a, b), _seconds(c, d)
    return _lower(p, q), _upper(p, q), _lower(r, s), _upper(r, s)


@inlined
def spread(value):
    """Return four times each of the four numbers."""
    return _all_of_0(value, value), _all_of_1(value, value), _all_of_2(value, value), _all_of_3(value, value)


@inlined
def with_fourth(a, b, c, d, fourth):
    """Return a, b, c, d with the numbers of ``fourth`` in their fourth places, one for each."""
    return _with_0(a, fourth), _with_1(b, fourth), _with_2(c, fourth), _with_3(d, fourth)


@inlined
def coordinates(a, b, c):
    """Return (a, b, c, 0)."""
    value = all4(np.float32(0))
    return _put(_put(_put(value, a, 0), b, 1), c, 2)


@intrinsic
def _put(typing_context, value, number, place):
    def generate(context, builder, signature, arguments):
        return builder.insert_element(*arguments[:2], builder.trunc(arguments[2], _WORD))

    return FOUR(FOUR, types.float32, types.int64), generate


@intrinsic
def number_at(typing_context, value, place):
    """Return one of the four numbers."""

    def generate(context, builder, signature, arguments):
        return builder.extract_element(arguments[0], builder.trunc(arguments[1], _WORD))

    return types.float32(FOUR, types.int64), generate


_WORDS = ir.VectorType(_WORD, LANES)


@intrinsic
def _times_power(typing_context, value, shifted):
    """Return ``value`` times 2^n for the whole number n that was added to 1.5 * 2^23, with the sum in ``shifted``."""

    def generate(context, builder, signature, arguments):
        value, shifted = (builder.bitcast(argument, _WORDS) for argument in arguments)
        power = builder.shl(shifted, ir.Constant(_WORDS, [23] * LANES))
        return builder.bitcast(builder.add(value, power), _FOUR)

    return FOUR(FOUR, FOUR), generate


@intrinsic
def _exponent(typing_context, value):
    """Return the whole numbers n for which positive numbers are 2^n m, m between the roots of 1/2 and 2."""

    def generate(context, builder, signature, arguments):
        words = builder.bitcast(arguments[0], _WORDS)
        over = builder.sub(words, ir.Constant(_WORDS, [0x3F3504F3] * LANES))
        return builder.sitofp(builder.ashr(over, ir.Constant(_WORDS, [23] * LANES)), _FOUR)

    return FOUR(FOUR), generate


@inlined
def exponential(x):
    """Return e^x, to two units in the last place; x is taken to lie between -87 and 88."""
    x = larger(x, all4(np.float32(-87)))
    x = all4(np.float32(0)) - larger(all4(np.float32(0)) - x, all4(np.float32(-88)))
    shift = all4(np.float32(12582912.0))
    shifted = x * all4(np.float32(1.44269504)) + shift
    n = shifted - shift
    # The logarithm of 2 in two parts (Cody & Waite), the rest by its series.
    x = (x - n * all4(np.float32(0.693359375))) + n * all4(np.float32(2.12194440e-4))
    p = all4(np.float32(1.9875691500e-4)) * x + all4(np.float32(1.3981999507e-3))
    p = p * x + all4(np.float32(8.3334519073e-3))
    p = p * x + all4(np.float32(4.1665795894e-2))
    p = p * x + all4(np.float32(1.6666665459e-1))
    p = p * x + all4(np.float32(5.0000001201e-1))
    return _times_power(p * (x * x) + x + all4(np.float32(1)), shifted)


@inlined
def logarithm(x):
    """Return the natural logarithm of positive numbers, to two units in the last place (coefficients: Cephes, logf)."""
    n = _exponent(x)
    shift = all4(np.float32(12582912.0))
    y = _times_power(x, shift - n) - all4(np.float32(1))
    p = all4(np.float32(7.0376836292e-2)) * y - all4(np.float32(1.1514610310e-1))
    p = p * y + all4(np.float32(1.1676998740e-1))
    p = p * y - all4(np.float32(1.2420140846e-1))
    p = p * y + all4(np.float32(1.4249322787e-1))
    p = p * y - all4(np.float32(1.6668057665e-1))
    p = p * y + all4(np.float32(2.0000714765e-1))
    p = p * y - all4(np.float32(2.4999993993e-1))
    p = p * y + all4(np.float32(3.3333331174e-1))
    square = y * y
    small = p * (y * square) - n * all4(np.float32(2.12194440e-4)) - all4(np.float32(0.5)) * square
    return (y + small) + n * all4(np.float32(0.693359375))


@inlined
def logistic(x):
    """Return 1 / (1 + e^-x)."""
    return all4(np.float32(1)) / (all4(np.float32(1)) + exponential(all4(np.float32(0)) - x))


@inlined
def softplus(x):
    """Return log(1 + e^x)."""
    one, zero = all4(np.float32(1)), all4(np.float32(0))
    # Of the larger of the two powers the logarithm is known.
    power = exponential(zero - larger(x, zero - x))
    above = (one + power) - one
    # What rounding takes from 1 + e^x is given back (Kahan).
    small = where_larger(above, zero, logarithm(one + above) * (power / larger(above, all4(np.float32(1e-30)))), power)
    return larger(x, zero) + small
