"""The kernel that goes through all layers, the products with their weights included, in one launch, or through a whole step.

For float32, and where :mod:`dmp.compiled.packed_weights` has a product. Its phases are rows of a table of int64, which
:mod:`dmp.compiled.fused_stack` writes for layers and :mod:`dmp.whole_step` for what a step has beside them. Rows of a
layer are used while they are in the cache: a sweep goes over parts of the vertices and finishes a block of them as soon as
the rows of all its neighbours are there; what has neighbours in other parts comes in a second phase. Nothing is kept that is
cheaper to make again: backward a block of the former y comes from its z, which is needed there anyway, and is multiplied into
the gradient of the weights at once. What only neighbours ask for lies in places that are given to other blocks as soon as
nobody asks any more.
"""

# Numba has no types for mypy, and its compiler reads signatures from values.
# mypy: ignore-errors
from __future__ import annotations

from dmp.compiled.kernel import kernel
from dmp.compiled.linear_rows import add_rows, add_to_rows, leaky_rows, of_leaky_rows
from dmp.compiled.loss_kernels import losses_part
from dmp.compiled.parameter_rows import PIECE_BYTES, adam_piece, has_a_bad_value
from dmp.compiled.phases import FIRST_ARGUMENT, next_part, part_is_done
from dmp.compiled.pointers import (
    add_product,
    doubles,
    floats,
    multiply_few,
    multiply_rows,
    numbers,
    pack_weights,
    row_function,
    words,
)
from dmp.compiled.stack_rows import (
    activate_rows,
    derive_rows,
    gather_rows,
    join_moments,
    join_sums,
    moments_rows,
    sums_rows,
)
from dmp.compiled.vectors import LANES

# What is done in a phase.
SWEEP, FINISH, ACTIVATE, SUMS, JOIN_MOMENTS, JOIN_SUMS, PACK, ADD_UP, ENDS, OF_ENDS, LOSSES, LOOK, ADAM = range(13)
# The ways through a layer: forward and backward, where the product with the weights comes before P, and where P comes first.
FORWARD_MULTIPLYING, FORWARD_GATHERING, BACKWARD_MULTIPLYING, BACKWARD_GATHERING = range(4)

# What stands where in a phase: addresses, but for kind, way, sizes and counts. All that does not apply is 0. The way of LOSSES
# is 0 or 1, their first phase or the second; the queue of ADAM is one of pieces.
FIELDS = (
    *("kind", "way", "n_rows", "block_rows", "n_in", "n_out"),
    # P; which rows belong to a part, which blocks are finished in it, and the largest column of each of all blocks.
    *("starts", "columns", "values", "bounds", "queue_starts", "queue", "highest"),
    # Places for blocks, and which of them each block has; a place of its own for each part, and its bytes.
    *("places", "slots", "own", "own_bytes"),
    # The function that multiplies, and packed weights.
    *("multiply", "packed"),
    # What comes before: z and by what it is normalised; or the features, before the first layer.
    *("z_before", "mean_before", "scale_before", "beta_before", "features"),
    # The layer: z, by what it is normalised, and numbers for the gradient of z.
    *("z", "mean", "scale", "beta", "slope", "constant", "over_deviation", "gamma"),
    # P y, where P comes first; sums of blocks, and room for adding them up.
    *("gathered", "first_sums", "second_sums", "joined"),
    # Gradients: of y, of the y before, of gamma and beta, of the weights, and what other parts than the first add to those.
    *("of_y", "of_before", "of_gamma", "of_beta", "of_weight", "of_weight_others", "others_bytes"),
    # The output; for packing: function, weights (address, packed, in, out, order of MKL) and their number.
    *("output", "pack", "weights", "n_weights"),
    # The linear layers: output of the first, weights and biases of both, their channels, what is added; gradient of the output.
    *("hidden", "hidden_weight", "hidden_bias", "n_hidden", "last_weight", "last_bias", "n_last", "base", "of_output"),
    # The losses' own arguments, and where the loss is; gradients, their number, and whether a part has found a bad one; what
    # Adam needs of each piece, and its settings.
    *("losses", "loss", "gradients", "n_gradients", "flags", "pieces", "settings"),
)
(
    _KIND, _WAY, _N_ROWS, _BLOCK_ROWS, _IN, _OUT,
    _STARTS, _COLUMNS, _VALUES, _BOUNDS, _QUEUE_STARTS, _QUEUE, _HIGHEST,
    _PLACES, _SLOTS, _OWN, _OWN_BYTES,
    _MULTIPLY, _PACKED,
    _Z_BEFORE, _MEAN_BEFORE, _SCALE_BEFORE, _BETA_BEFORE, _FEATURES,
    _Z, _MEAN, _SCALE, _BETA, _SLOPE, _CONSTANT, _OVER_DEVIATION, _GAMMA,
    _GATHERED, _FIRST_SUMS, _SECOND_SUMS, _JOINED,
    _OF_Y, _OF_BEFORE, _OF_GAMMA, _OF_BETA, _OF_WEIGHT, _OF_WEIGHT_OTHERS, _OTHERS_BYTES,
    _OUTPUT, _PACK, _WEIGHTS, _N_WEIGHTS,
    _HIDDEN, _HIDDEN_WEIGHT, _HIDDEN_BIAS, _N_HIDDEN, _LAST_WEIGHT, _LAST_BIAS, _N_LAST, _BASE, _OF_OUTPUT,
    _LOSSES, _LOSS, _GRADIENTS, _N_GRADIENTS, _FLAGS, _PIECES, _SETTINGS,
) = range(len(FIELDS))  # fmt: skip

# Numbers that describe a matrix of weights to be packed.
WEIGHT_WORDS = 5

_SIZE, _WORD_SIZE = 4, 8  # bytes of a float32 and of an int64
_PHASE_BYTES = _WORD_SIZE * len(FIELDS)


@row_function
def _at(address, row, channels):
    return address + _SIZE * row * channels


@row_function
def _own(job, part, number):
    """Return where one of the two blocks begins that a part has for itself."""
    return job[_OWN] + (2 * part + number) * job[_OWN_BYTES]


@row_function
def _last(job, first):
    return min(job[_N_ROWS], first + job[_BLOCK_ROWS])


@row_function
def _block(job, first):
    return first // job[_BLOCK_ROWS]


@row_function
def _place(job, first, channels):
    """Return the place of a block where its neighbours look for it."""
    return _at(job[_PLACES], numbers(job[_SLOTS])[_block(job, first)] * job[_BLOCK_ROWS], channels)


@row_function
def _share(part, parts, count):
    """Return the first of ``count`` numbers of a part, and the one after its last: whole vectors."""
    vectors = (count + LANES - 1) // LANES
    return min(count, part * vectors // parts * LANES), min(count, (part + 1) * vectors // parts * LANES)


@row_function
def _activate_before(job, first, place):
    """Write the y before of a block to ``place``."""
    channels = job[_IN]
    activate_rows(
        floats(job[_Z_BEFORE]), floats(_at(place, -first, channels)),
        floats(job[_MEAN_BEFORE]), floats(job[_SCALE_BEFORE]), floats(job[_BETA_BEFORE]), first, _last(job, first), channels,
    )  # fmt: skip


@row_function
def _derive(job, first, place):
    """Write the gradient of z of a block to ``place``."""
    channels = job[_OUT]
    derive_rows(
        floats(job[_OF_Y]), floats(job[_Z]), floats(_at(place, -first, channels)), floats(job[_MEAN]), floats(job[_SCALE]),
        floats(job[_BETA]), floats(job[_SLOPE]), floats(job[_CONSTANT]), first, _last(job, first), channels,
    )  # fmt: skip


@row_function
def _gather(job, first, place, channels):
    """Write P times what lies in the places to ``place``, for a block."""
    gather_rows(
        numbers(job[_STARTS]), numbers(job[_COLUMNS]), floats(job[_VALUES]), floats(job[_PLACES]),
        floats(_at(place, -first, channels)), first, _last(job, first), channels,
    )  # fmt: skip


@row_function
def _multiply(job, x, y, n_in, n_out):
    # Always whole blocks, as the weights were packed for; there is room for them behind the last row.
    multiply_rows(job[_MULTIPLY], job[_BLOCK_ROWS], x, job[_PACKED], y, n_in, n_out)


@row_function
def _moments(job, first):
    """Write what the moments of z are made of, unless they are given."""
    if job[_FIRST_SUMS] == 0:
        return
    channels = job[_OUT]
    place = _at(0, _block(job, first), channels)
    moments_rows(
        floats(job[_Z]), floats(job[_FIRST_SUMS] + place), floats(job[_SECOND_SUMS] + place),
        first, _last(job, first), channels,
    )  # fmt: skip


@row_function
def _sums_before(job, first):
    channels = job[_IN]
    place = _at(0, _block(job, first), channels)
    sums_rows(
        floats(job[_OF_BEFORE]), floats(job[_Z_BEFORE]), floats(job[_MEAN_BEFORE]), floats(job[_SCALE_BEFORE]),
        floats(job[_BETA_BEFORE]), floats(job[_FIRST_SUMS] + place), floats(job[_SECOND_SUMS] + place),
        first, _last(job, first), channels,
    )  # fmt: skip


@row_function
def _of_weight(job, part):
    """Return where a part adds to the gradient of the weights."""
    return job[_OF_WEIGHT] if part == 0 else job[_OF_WEIGHT_OTHERS] + (part - 1) * job[_OTHERS_BYTES]


@row_function
def _add_to_weights(job, part, first, features, gradient):
    """Add what a block gives to the gradient of the weights: the transposed features times the gradient of their product."""
    rows = _last(job, first) - first
    add_product(job[_MULTIPLY], rows, features, gradient, _of_weight(job, part), job[_IN], job[_OUT])


@row_function
def _before(job, part, first):
    """Return where the y before of a block lies, made for the purpose, or the features before the first layer."""
    if job[_Z_BEFORE] == 0:
        return _at(job[_FEATURES], first, job[_IN])
    place = _own(job, part, 0)
    _activate_before(job, first, place)
    return place


@row_function
def _begin(job, part, first):
    """Do all with a block that needs no other: write what its neighbours ask for to its place."""
    n_in, n_out = job[_IN], job[_OUT]
    if job[_WAY] == FORWARD_MULTIPLYING:
        _multiply(job, _before(job, part, first), _place(job, first, n_out), n_in, n_out)
    elif job[_WAY] == FORWARD_GATHERING:
        _activate_before(job, first, _place(job, first, n_in))
    elif job[_WAY] == BACKWARD_MULTIPLYING:
        _derive(job, first, _place(job, first, n_out))
    else:
        of_z = _own(job, part, 0)
        _derive(job, first, of_z)
        # The features before the first layer have a gradient only where that is asked for.
        if job[_OF_BEFORE] != 0:
            _multiply(job, of_z, _place(job, first, n_in), n_out, n_in)
        _add_to_weights(job, part, first, _at(job[_GATHERED], first, n_in), of_z)


@row_function
def _finish(job, part, first):
    """Do the rest with a block whose neighbours' rows are in their places."""
    n_in, n_out = job[_IN], job[_OUT]
    if job[_WAY] == FORWARD_MULTIPLYING:
        _gather(job, first, _at(job[_Z], first, n_out), n_out)
        _moments(job, first)
    elif job[_WAY] == FORWARD_GATHERING:
        gathered = _at(job[_GATHERED], first, n_in)
        _gather(job, first, gathered, n_in)
        _multiply(job, gathered, _at(job[_Z], first, n_out), n_in, n_out)
        _moments(job, first)
    elif job[_WAY] == BACKWARD_MULTIPLYING:
        spread = _own(job, part, 1)
        _gather(job, first, spread, n_out)
        if job[_OF_BEFORE] != 0:
            _multiply(job, spread, _at(job[_OF_BEFORE], first, n_in), n_out, n_in)
        if job[_Z_BEFORE] != 0:
            _sums_before(job, first)
        _add_to_weights(job, part, first, _before(job, part, first), spread)
    elif job[_OF_BEFORE] != 0:
        _gather(job, first, _at(job[_OF_BEFORE], first, n_in), n_in)
        if job[_Z_BEFORE] != 0:
            _sums_before(job, first)


@row_function
def _sweep(job, part):
    """Begin all blocks of a part, and finish those that have all their neighbours in it."""
    bounds, queue_starts, queue, highest = (
        numbers(job[_BOUNDS]), numbers(job[_QUEUE_STARTS]), numbers(job[_QUEUE]), numbers(job[_HIGHEST])
    )  # fmt: skip
    if job[_WAY] >= BACKWARD_MULTIPLYING:
        of_weight = floats(_of_weight(job, part))
        for i in range(job[_IN] * job[_OUT]):
            of_weight[i] = 0
    k = queue_starts[part]
    rows = job[_BLOCK_ROWS]
    for first in range(bounds[part], bounds[part + 1], rows):
        _begin(job, part, first)
        while k < queue_starts[part + 1] and highest[queue[k]] < first + rows:
            _finish(job, part, queue[k] * rows)
            k += 1


@row_function
def _finish_others(job, part):
    """Finish blocks in the queue, all of whose neighbours are there."""
    queue_starts, queue = numbers(job[_QUEUE_STARTS]), numbers(job[_QUEUE])
    for k in range(queue_starts[part], queue_starts[part + 1]):
        _finish(job, part, queue[k] * job[_BLOCK_ROWS])


@row_function
def _join_moments(job, part, parts):
    """From sums of blocks: mean and 1 / deviation of z, and gamma over the deviation."""
    channels = job[_OUT]
    first, last = _share(part, parts, channels)
    gamma, scale, over_deviation = floats(job[_GAMMA]), floats(job[_SCALE]), floats(job[_OVER_DEVIATION])
    join_moments(
        floats(job[_FIRST_SUMS]), floats(job[_SECOND_SUMS]), doubles(job[_JOINED]), floats(job[_MEAN]), over_deviation,
        job[_N_ROWS], job[_BLOCK_ROWS], channels, first, last,
    )  # fmt: skip
    for c in range(first, last):
        scale[c] = gamma[c] * over_deviation[c]


@row_function
def _join_sums(job, part, parts):
    """From sums of blocks: gradients of gamma and beta, and numbers for the gradient of z."""
    channels = job[_OUT]
    first, last = _share(part, parts, channels)
    join_sums(
        floats(job[_FIRST_SUMS]), floats(job[_SECOND_SUMS]), doubles(job[_JOINED]), floats(job[_OVER_DEVIATION]),
        floats(job[_SCALE]), floats(job[_OF_GAMMA]), floats(job[_OF_BETA]), floats(job[_SLOPE]), floats(job[_CONSTANT]),
        job[_N_ROWS], job[_BLOCK_ROWS], channels, first, last,
    )  # fmt: skip


@row_function
def _pack(job, part, parts):
    """Pack every so many-th matrix of weights."""
    for number in range(part, job[_N_WEIGHTS], parts):
        weight = words(job[_WEIGHTS] + _WORD_SIZE * WEIGHT_WORDS * number)
        pack_weights(job[_PACK], job[_BLOCK_ROWS], weight[0], weight[1], weight[2], weight[3], weight[4])


@row_function
def _add_up(job, part, parts):
    """Add what the other parts have for the gradient of the weights to what the first one has."""
    total = floats(job[_OF_WEIGHT])
    first, last = _share(part, parts, job[_OTHERS_BYTES] // _SIZE)
    for other in range(parts - 1):
        more = floats(job[_OF_WEIGHT_OTHERS] + other * job[_OTHERS_BYTES])
        for i in range(first, last):
            total[i] += more[i]


@row_function
def _over_blocks(job, part, parts):
    """Write the output of the last layer or what the linear ones make of it, or the sums for its gradient."""
    if job[_KIND] == OF_ENDS:
        of_weight = floats(_of_weight(job, part))
        for i in range(job[_N_GRADIENTS]):
            of_weight[i] = 0
    rows = job[_BLOCK_ROWS]
    blocks = (job[_N_ROWS] + rows - 1) // rows
    for first in range(part * blocks // parts * rows, min(job[_N_ROWS], (part + 1) * blocks // parts * rows), rows):
        if job[_KIND] == ACTIVATE:
            _activate_before(job, first, _at(job[_OUTPUT], first, job[_IN]))
        elif job[_KIND] == ENDS:
            _end(job, part, first)
        elif job[_KIND] == OF_ENDS:
            _of_end(job, part, first)
        else:
            _sums_before(job, first)


@row_function
def _end(job, part, first):
    """Write what both linear layers make of a block."""
    n_in, n_hidden, n_last, rows = job[_IN], job[_N_HIDDEN], job[_N_LAST], _last(job, first) - first
    y, hidden_at, output_at = _own(job, part, 0), _at(job[_HIDDEN], first, n_hidden), _at(job[_OUTPUT], first, n_last)
    _activate_before(job, first, y)
    multiply_few(job[_MULTIPLY], 1, rows, y, job[_HIDDEN_WEIGHT], hidden_at, n_in, n_hidden)
    leaky_rows(floats(hidden_at), floats(job[_HIDDEN_BIAS]), rows, n_hidden)
    multiply_few(job[_MULTIPLY], 1, rows, hidden_at, job[_LAST_WEIGHT], output_at, n_hidden, n_last)
    add_to_rows(floats(output_at), floats(job[_LAST_BIAS]), rows, n_last)
    if job[_BASE] != 0:
        base, output = floats(_at(job[_BASE], first, n_last)), floats(output_at)
        for i in range(rows * n_last):
            output[i] += base[i]


@row_function
def _of_end(job, part, first):
    """Write the gradient of a block of what goes into the linear layers, and add to those of their parameters."""
    n_in, n_hidden, n_last, rows = job[_IN], job[_N_HIDDEN], job[_N_LAST], _last(job, first) - first
    # Gradients of the parameters follow upon each other.
    of_hidden_weight = _of_weight(job, part)
    of_hidden_bias = of_hidden_weight + _SIZE * n_hidden * n_in
    of_last_weight = of_hidden_bias + _SIZE * n_hidden
    of_last_bias = of_last_weight + _SIZE * n_last * n_hidden
    y, of_hidden = _own(job, part, 0), _own(job, part, 1)
    hidden, of_output = _at(job[_HIDDEN], first, n_hidden), _at(job[_OF_OUTPUT], first, n_last)
    add_product(job[_MULTIPLY], rows, of_output, hidden, of_last_weight, n_last, n_hidden)
    add_rows(floats(of_output), floats(of_last_bias), rows, n_last)
    multiply_few(job[_MULTIPLY], 0, rows, of_output, job[_LAST_WEIGHT], of_hidden, n_last, n_hidden)
    of_leaky_rows(floats(of_hidden), floats(hidden), rows, n_hidden)
    add_rows(floats(of_hidden), floats(of_hidden_bias), rows, n_hidden)
    _activate_before(job, first, y)
    add_product(job[_MULTIPLY], rows, of_hidden, y, of_hidden_weight, n_hidden, n_in)
    of_y = _at(job[_OF_BEFORE], first, n_in)
    multiply_few(job[_MULTIPLY], 0, rows, of_hidden, job[_HIDDEN_WEIGHT], of_y, n_hidden, n_in)
    _sums_before(job, first)


@row_function
def _look(job, part, parts):
    """Say whether any gradient in a part of them is infinite or no number."""
    first, last = _share(part, parts, job[_N_GRADIENTS])
    numbers(job[_FLAGS])[part] = has_a_bad_value(numbers(job[_GRADIENTS]), first, last)


@row_function
def _adam(job, part, parts):
    """Update a part of the parameters, unless the loss or any gradient is infinite or no number."""
    if has_a_bad_value(numbers(job[_LOSS]), 0, 1):
        return
    flags, queue_starts = numbers(job[_FLAGS]), numbers(job[_QUEUE_STARTS])
    for other in range(parts):
        if flags[other] != 0:
            return
    for number in range(queue_starts[part], queue_starts[part + 1]):
        adam_piece(words(job[_PIECES] + PIECE_BYTES * number), doubles(job[_SETTINGS]))


@row_function
def _do(job, part, parts):
    kind = job[_KIND]
    if kind == SWEEP:
        _sweep(job, part)
    elif kind == FINISH:
        _finish_others(job, part)
    elif kind == JOIN_MOMENTS:
        _join_moments(job, part, parts)
    elif kind == JOIN_SUMS:
        _join_sums(job, part, parts)
    elif kind == PACK:
        _pack(job, part, parts)
    elif kind == ADD_UP:
        _add_up(job, part, parts)
    elif kind == LOSSES:
        losses_part(words(job[_LOSSES]), job[_WAY], part, parts)
    elif kind == LOOK:
        _look(job, part, parts)
    elif kind == ADAM:
        _adam(job, part, parts)
    else:
        _over_blocks(job, part, parts)


@kernel
def run_phases(job):
    """Table of phases: do all of them."""
    while True:
        phase, part = next_part(job)
        if phase < 0:
            break
        _do(words(job[FIRST_ARGUMENT] + phase * _PHASE_BYTES), part, job[1])
        part_is_done(job)
