"""What compiled kernels need to read and write the memory of tensors: numbers of 32 and 16 bits at addresses.

Rows of an array as views cost more than the sums over short rows; addresses cost nothing.
"""

# Numba has no types for mypy, and its compiler reads signatures from values.
# mypy: ignore-errors
from __future__ import annotations

from llvmlite import ir
from numba import njit, types
from numba.extending import intrinsic

from dmp.compiled.packed_weights import BY_ROWS, PACKED, PLAIN, RIGHT_FACTOR, TRANSPOSED

# Fused multiply and add, and no care for the sign of 0; sums keep their order, so that results repeat bit for bit.
OPTIONS = {"nogil": True, "fastmath": {"contract", "nsz"}, "error_model": "numpy", "boundscheck": False}
row_function = njit(**OPTIONS)

_FLOATS, _HALVES, _NUMBERS = types.CPointer(types.float32), types.CPointer(types.uint16), types.CPointer(types.int32)
_DOUBLES, _WORDS = types.CPointer(types.float64), types.CPointer(types.int64)


def _pointer_to(result):
    def typed(typing_context, address):
        def generate(context, builder, signature, arguments):
            return builder.inttoptr(arguments[0], context.get_value_type(signature.return_type))

        return result(types.int64), generate

    return typed


@intrinsic
def floats(typing_context, address):
    """Return a pointer to float32 at ``address``."""
    return _pointer_to(_FLOATS)(typing_context, address)


@intrinsic
def doubles(typing_context, address):
    """Return a pointer to float64 at ``address``."""
    return _pointer_to(_DOUBLES)(typing_context, address)


@intrinsic
def halves(typing_context, address):
    """Return a pointer to bfloat16 at ``address``."""
    return _pointer_to(_HALVES)(typing_context, address)


@intrinsic
def numbers(typing_context, address):
    """Return a pointer to int32 at ``address``."""
    return _pointer_to(_NUMBERS)(typing_context, address)


def _call_product(builder, function, plan, sizes, factors, keep, out):
    """Call ``cblas_sgemm_compute``: how rows and factors are ordered, (M, N, K), (factor, row length) twice, beta, out."""
    word, real, pointer = ir.IntType(32), ir.FloatType(), ir.FloatType().as_pointer()
    codes = [ir.Constant(word, code) for code in plan]
    places = [
        builder.inttoptr(part, pointer) if is_address else builder.trunc(part, word)
        for address, length in (*factors, out)
        for part, is_address in ((address, True), (length, False))
    ]
    given = [*codes, *(builder.trunc(size, word) for size in sizes), *places[:4], ir.Constant(real, keep), *places[4:]]
    kind = ir.FunctionType(ir.VoidType(), [argument.type for argument in given])
    builder.call(builder.inttoptr(function, kind.as_pointer()), given)


@intrinsic
def words(typing_context, address):
    """Return a pointer to int64 at ``address``."""
    return _pointer_to(_WORDS)(typing_context, address)


@intrinsic
def multiply_rows(typing_context, function, rows, features, packed, out, n_in, n_out):
    """Write ``features`` (rows, in) times packed weights (in, out) to ``out``; all but the sizes are addresses.

    ``function`` is ``cblas_sgemm_compute`` of Intel's MKL; see :mod:`dmp.compiled.packed_weights`.
    """

    def generate(context, builder, signature, arguments):
        function, rows, features, packed, out, n_in, n_out = arguments
        factors = (features, n_in), (packed, n_out)
        _call_product(builder, function, (BY_ROWS, PLAIN, PACKED), (rows, n_out, n_in), factors, 0.0, (out, n_out))
        return context.get_dummy_value()

    return types.void(*[types.int64] * 7), generate


@intrinsic
def multiply_few(typing_context, function, is_transposed, rows, features, weights, out, n_in, n_out):
    """Write ``features`` (rows, in) times ``weights`` to ``out``; these are (in, out), or (out, in) if ``is_transposed``.

    Nothing is packed, so it is for few channels, and for any number of rows; see above.
    """

    def generate(context, builder, signature, arguments):
        function, is_transposed, rows, features, weights, out, n_in, n_out = arguments
        zero = ir.Constant(is_transposed.type, 0)
        with builder.if_else(builder.icmp_signed("!=", is_transposed, zero)) as (transposed, plain):
            for branch, order, length in ((transposed, TRANSPOSED, n_in), (plain, PLAIN, n_out)):
                with branch:
                    factors = (features, n_in), (weights, length)
                    sizes = rows, n_out, n_in
                    _call_product(builder, function, (BY_ROWS, PLAIN, order), sizes, factors, 0.0, (out, n_out))
        return context.get_dummy_value()

    return types.void(*[types.int64] * 8), generate


@intrinsic
def add_product(typing_context, function, rows, features, gradients, out, n_in, n_out):
    """Add the transposed ``features`` (rows, in) times ``gradients`` (rows, out) to ``out`` (in, out); see above."""

    def generate(context, builder, signature, arguments):
        function, rows, features, gradients, out, n_in, n_out = arguments
        factors = (features, n_in), (gradients, n_out)
        _call_product(builder, function, (BY_ROWS, TRANSPOSED, PLAIN), (n_in, n_out, rows), factors, 1.0, (out, n_out))
        return context.get_dummy_value()

    return types.void(*[types.int64] * 7), generate


@intrinsic
def pack_weights(typing_context, function, rows, weights, packed, n_in, n_out, order):
    """Write weights (in, out), or (out, in) where MKL's ``order`` is 112, to ``packed``, for products of so many ``rows``.

    ``function`` is ``cblas_sgemm_pack``; see :mod:`dmp.compiled.packed_weights`.
    """

    def generate(context, builder, signature, arguments):
        word, real, pointer = ir.IntType(32), ir.FloatType(), ir.FloatType().as_pointer()
        function, rows, weights, packed, n_in, n_out, order = arguments
        weights, packed = (builder.inttoptr(address, pointer) for address in (weights, packed))
        rows, n_in, n_out, order = (builder.trunc(size, word) for size in (rows, n_in, n_out, order))
        is_transposed = builder.icmp_signed("==", order, ir.Constant(word, TRANSPOSED))
        length = builder.select(is_transposed, n_in, n_out)
        by_rows, right_factor, one = ir.Constant(word, BY_ROWS), ir.Constant(word, RIGHT_FACTOR), ir.Constant(real, 1.0)
        given = [by_rows, right_factor, order, rows, n_out, n_in, one, weights, length, packed]
        kind = ir.FunctionType(ir.VoidType(), [argument.type for argument in given])
        builder.call(builder.inttoptr(function, kind.as_pointer()), given)
        return context.get_dummy_value()

    return types.void(*[types.int64] * 7), generate


@intrinsic
def take_next(typing_context, counter):
    """Return the int64 at ``counter`` and add 1 to it, in one go for all threads."""

    def generate(context, builder, signature, arguments):
        one = context.get_constant(types.int64, 1)
        return builder.atomic_rmw("add", arguments[0], one, "monotonic")

    return types.int64(types.CPointer(types.int64)), generate
