"""What compiled kernels need to read and write the memory of tensors: numbers of 32 and 16 bits at addresses.

Rows of an array as views cost more than the sums over short rows; addresses cost nothing.
"""

# Numba has no types for mypy, and its compiler reads signatures from values.
# mypy: ignore-errors
from __future__ import annotations

from llvmlite import ir
from numba import njit, types
from numba.extending import intrinsic

# Fused multiply and add, and no care for the sign of 0; sums keep their order, so that results repeat bit for bit.
OPTIONS = {"nogil": True, "fastmath": {"contract", "nsz"}, "error_model": "numpy", "boundscheck": False}
row_function = njit(**OPTIONS)

_FLOATS, _HALVES, _NUMBERS = types.CPointer(types.float32), types.CPointer(types.uint16), types.CPointer(types.int32)
_DOUBLES = types.CPointer(types.float64)


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


@intrinsic
def multiply_rows(typing_context, function, rows, features, packed, out, n_in, n_out):
    """Write ``features`` (rows, in) times packed weights (in, out) to ``out``; all but the sizes are addresses.

    ``function`` is ``cblas_sgemm_compute`` of Intel's MKL; see :mod:`dmp.compiled.packed_weights`.
    """

    def generate(context, builder, signature, arguments):
        word, real, pointer = ir.IntType(32), ir.FloatType(), ir.FloatType().as_pointer()
        function, rows, features, packed, out, n_in, n_out = arguments
        rows, n_in, n_out = (builder.trunc(size, word) for size in (rows, n_in, n_out))
        features, packed, out = (builder.inttoptr(address, pointer) for address in (features, packed, out))
        row_major, plain, is_packed = (ir.Constant(word, code) for code in (101, 111, 151))
        given = [
            row_major, plain, is_packed, rows, n_out, n_in, features, n_in, packed, n_out, ir.Constant(real, 0.0), out, n_out
        ]  # fmt: skip
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
