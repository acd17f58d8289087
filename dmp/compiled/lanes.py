"""Some float32 at a time, for kernels: four, or the twelve of a message.

Four are three coordinates and one number more, or the same number of four faces. A vertex or a face that is gathered is one
load of four; turned (:func:`turned`), four of them are computed with at once. Every processor of the last twenty years has
registers for four, and the compiler divides twelve among those that there are.
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

LANES, ROW = 4, 12

# Calls cost more than what is done with four numbers.
inlined = njit(forceinline=True, **OPTIONS)

_FLAGS = ("contract", "nsz")
_REAL, _WORD = ir.FloatType(), ir.IntType(32)
_FOUR = ir.VectorType(_REAL, LANES)
_UNDEFINED = ir.Constant(_FOUR, ir.Undefined)


class _Lanes(types.Type):
    def __init__(self, count):
        self.count = count
        super().__init__(name=f"Lanes{count}")


FOUR, TWELVE = _Lanes(LANES), _Lanes(ROW)


@register_model(_Lanes)
class _LanesModel(models.PrimitiveModel):
    def __init__(self, manager, kind):
        super().__init__(manager, kind, ir.VectorType(_REAL, kind.count))


def _define(symbol, name):
    @type_callable(symbol)
    def typed(context):
        def typer(left, right):
            return left if left == right and isinstance(left, _Lanes) else None

        return typer

    def lowered(context, builder, signature, arguments):
        return getattr(builder, name)(*arguments, flags=_FLAGS)

    for kind in (FOUR, TWELVE):
        lower_builtin(symbol, kind, kind)(lowered)


for _symbol, _name in ((operator.add, "fadd"), (operator.sub, "fsub"), (operator.mul, "fmul"), (operator.truediv, "fdiv")):
    _define(_symbol, _name)


def _loading(kind):
    @intrinsic
    def loaded(typing_context, pointer, index):
        def generate(context, builder, signature, arguments):
            place = builder.bitcast(builder.gep(arguments[0], [arguments[1]]), context.get_value_type(kind).as_pointer())
            return builder.load(place, align=4)

        return kind(pointer, types.int64), generate

    return loaded


# The four, or twelve, numbers from ``pointer[index]`` on.
load4, load12 = _loading(FOUR), _loading(TWELVE)


@intrinsic
def _store(typing_context, pointer, index, value):
    def generate(context, builder, signature, arguments):
        place = builder.bitcast(builder.gep(arguments[0], [arguments[1]]), arguments[2].type.as_pointer())
        builder.store(arguments[2], place, align=4)
        return context.get_dummy_value()

    return types.void(pointer, types.int64, value), generate


# Write the numbers from ``pointer[index]`` on.
store4 = store12 = _store


def _repeating(kind):
    @intrinsic
    def repeated(typing_context, number):
        def generate(context, builder, signature, arguments):
            return _repeated(builder, arguments[0], context.get_value_type(kind))

        return kind(types.float32), generate

    return repeated


def _repeated(builder, number, vector):
    undefined = ir.Constant(vector, ir.Undefined)
    first = builder.insert_element(undefined, number, ir.Constant(_WORD, 0))
    return builder.shuffle_vector(first, undefined, _repeated_word(vector, 0))


def _repeated_word(vector, number):
    return ir.Constant(_words_of(vector), [number] * vector.count)


def _words_of(vector):
    return ir.VectorType(_WORD, vector.count)


# The same float32 four, or twelve, times.
all4, all12 = _repeating(FOUR), _repeating(TWELVE)


@intrinsic
def like(typing_context, number, value):
    """Return the float32 ``number`` as often as ``value`` has numbers."""

    def generate(context, builder, signature, arguments):
        return _repeated(builder, arguments[0], arguments[1].type)

    return value(types.float32, value), generate


@intrinsic
def square_root(typing_context, value):
    """Return the square roots."""

    def generate(context, builder, signature, arguments):
        vector, module = arguments[0].type, builder.module
        name = f"llvm.sqrt.v{vector.count}f32"
        function = module.globals.get(name) or ir.Function(module, ir.FunctionType(vector, [vector]), name)
        return builder.call(function, arguments)

    return value(value), generate


@intrinsic
def larger(typing_context, left, right):
    """Return the larger number of each pair."""

    def generate(context, builder, signature, arguments):
        left, right = arguments
        return builder.select(builder.fcmp_ordered(">", left, right), left, right)

    return left(left, left), generate


@intrinsic
def where_larger(typing_context, left, right, chosen, other):
    """Return ``chosen`` where ``left`` is larger than ``right``, and ``other`` elsewhere."""

    def generate(context, builder, signature, arguments):
        left, right, chosen, other = arguments
        return builder.select(builder.fcmp_ordered(">", left, right), chosen, other)

    return left(left, left, left, left), generate


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


@intrinsic
def _times_power(typing_context, value, shifted):
    """Return ``value`` times 2^n for the whole number n that was added to 1.5 * 2^23, with the sum in ``shifted``."""

    def generate(context, builder, signature, arguments):
        vector = arguments[0].type
        value, shifted = (builder.bitcast(argument, _words_of(vector)) for argument in arguments)
        return builder.bitcast(builder.add(value, builder.shl(shifted, _repeated_word(vector, 23))), vector)

    return value(value, value), generate


@intrinsic
def _exponent(typing_context, value):
    """Return the whole numbers n for which positive numbers are 2^n m, m between the roots of 1/2 and 2."""

    def generate(context, builder, signature, arguments):
        vector = arguments[0].type
        over = builder.sub(builder.bitcast(arguments[0], _words_of(vector)), _repeated_word(vector, 0x3F3504F3))
        return builder.sitofp(builder.ashr(over, _repeated_word(vector, 23)), vector)

    return value(value), generate


@inlined
def exponential(x):
    """Return e^x, to two units in the last place; x is taken to lie between -87 and 88."""
    x = larger(x, like(np.float32(-87), x))
    x = like(np.float32(0), x) - larger(like(np.float32(0), x) - x, like(np.float32(-88), x))
    shift = like(np.float32(12582912.0), x)
    shifted = x * like(np.float32(1.44269504), x) + shift
    n = shifted - shift
    # The logarithm of 2 in two parts (Cody & Waite), the rest by its series.
    x = (x - n * like(np.float32(0.693359375), x)) + n * like(np.float32(2.12194440e-4), x)
    p = like(np.float32(1.9875691500e-4), x) * x + like(np.float32(1.3981999507e-3), x)
    p = p * x + like(np.float32(8.3334519073e-3), x)
    p = p * x + like(np.float32(4.1665795894e-2), x)
    p = p * x + like(np.float32(1.6666665459e-1), x)
    p = p * x + like(np.float32(5.0000001201e-1), x)
    return _times_power(p * (x * x) + x + like(np.float32(1), x), shifted)


@inlined
def logarithm(x):
    """Return the natural logarithm of positive numbers, to two units in the last place (coefficients: Cephes, logf)."""
    n = _exponent(x)
    shift = like(np.float32(12582912.0), x)
    y = _times_power(x, shift - n) - like(np.float32(1), x)
    p = like(np.float32(7.0376836292e-2), x) * y - like(np.float32(1.1514610310e-1), x)
    p = p * y + like(np.float32(1.1676998740e-1), x)
    p = p * y - like(np.float32(1.2420140846e-1), x)
    p = p * y + like(np.float32(1.4249322787e-1), x)
    p = p * y - like(np.float32(1.6668057665e-1), x)
    p = p * y + like(np.float32(2.0000714765e-1), x)
    p = p * y - like(np.float32(2.4999993993e-1), x)
    p = p * y + like(np.float32(3.3333331174e-1), x)
    square = y * y
    small = p * (y * square) - n * like(np.float32(2.12194440e-4), x) - like(np.float32(0.5), x) * square
    return (y + small) + n * like(np.float32(0.693359375), x)


@inlined
def logistic(x):
    """Return 1 / (1 + e^-x)."""
    return like(np.float32(1), x) / (like(np.float32(1), x) + exponential(like(np.float32(0), x) - x))


@inlined
def softplus(x):
    """Return log(1 + e^x)."""
    one, zero = like(np.float32(1), x), like(np.float32(0), x)
    # Of the larger of the two powers the logarithm is known.
    power = exponential(zero - larger(x, zero - x))
    above = (one + power) - one
    # What rounding takes from 1 + e^x is given back (Kahan).
    small = where_larger(above, zero, logarithm(one + above) * (power / larger(above, like(np.float32(1e-30), x))), power)
    return larger(x, zero) + small


def _taking(places):
    @intrinsic
    def taken(typing_context, value):
        def generate(context, builder, signature, arguments):
            mask = ir.Constant(ir.VectorType(_WORD, LANES), places)
            return builder.shuffle_vector(arguments[0], ir.Constant(arguments[0].type, ir.Undefined), mask)

        return FOUR(TWELVE), generate

    return taken


_first, _middle, _last = _taking([0, 1, 2, 3]), _taking([4, 5, 6, 7]), _taking([8, 9, 10, 11])


@inlined
def folded(row):
    """Return the sums of every fourth of twelve numbers."""
    return (_first(row) + _middle(row)) + _last(row)
