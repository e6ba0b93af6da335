"""The compiled loops. One specialisation of each serves every scene, a second one eight stretches of time at once.

All of them stay in this file: a cached function that calls one of another file would keep the old callee
after that file was edited, because numba looks at the time stamp of the caller's file only.

Arguments of the loops `newmark`, `gauss` and `exact_modal`:

packed        the system, :class:`kaneflex.integrate.system.Packed`
scalars       table of the motion, see below
period        steps in the table; it is read again from its start after the last one
position      steps already taken in this table
n_steps       steps to take
coefficients  numbers of the method, see `kaneflex.integrate.methods`
load          shape (columns,): factor on F for each column (1 for a motion, 0 for a free one)
state         z, v, a, q, each of shape (columns, n): displacements, velocities, the method's own and the true
              accelerations; overwritten. Several columns share one factorisation a step.
done, every   steps taken before this call; the first column is stored after every `every` steps
bound         largest sum of squares of z that is still believed
stored        z, v, true accelerations, each of shape (rows, n): row k belongs to step k * every

They return the number of completed steps and a status.

Lanes. Matrices are added up and factorised for LANES steps at once, a number of each in one register, read by `at`
and written by `put`. So the table of `newmark` and `gauss` has the shape (blocks * nodes, n_scalars, LANES): step
LANES * b + l is in block b, lane l, with its scalars at the stages, if there are any, and at its end. The steps
themselves follow one another. Where `state` and `stored` have an axis of LANES more, each lane is a motion of its own,
takes the step of its lane in every block, and all go side by side; they stop where any lane would.
"""

import math
import operator

import numpy as np
from llvmlite import ir
from numba import njit, types
from numba.core import cgutils
from numba.core.typing.templates import AbstractTemplate, infer_global, signature
from numba.extending import intrinsic, lower_builtin, models, overload, register_model

COMPLETED, SINGULAR, UNBOUNDED = 0, 1, 2
LANES = 8  # of 64 bits: a register of AVX-512, two of AVX

# Indices are unsigned throughout: with signed ones numba must test each for a negative value, which counts
# from the end, and nothing is vectorised. Mixed with a signed number an unsigned one would become a float.
_ONE, _TWO, _THREE = np.uint64(1), np.uint64(2), np.uint64(3)
_SMALLEST_PIVOT = 1e-14  # relative to what was added up to it: less is rounding
_STAGE_1, _STAGE_2 = 0.5 - math.sqrt(3.0) / 6.0, 0.5 + math.sqrt(3.0) / 6.0

# No "nnan", "ninf": the test for a runaway motion relies on comparisons with NaN being false.
_FASTMATH = {"nsz", "arcp", "contract", "afn", "reassoc"}
_jit = njit(cache=True, error_model="numpy", fastmath=_FASTMATH)
# A call costs as much as a small solve: numba hands over seven words an array.
_inlined = njit(inline="always", error_model="numpy", fastmath=_FASTMATH)

_VECTOR = ir.VectorType(ir.DoubleType(), LANES)
_INT = ir.IntType(32)


class _Lanes(types.Type):
    """LANES numbers in a register: numba's type of them."""


_lanes = _Lanes("Lanes")


@register_model(_Lanes)
class _LanesModel(models.PrimitiveModel):
    def __init__(self, manager, kind):
        super().__init__(manager, kind, _VECTOR)


def _spread(context, builder, kind, value):
    """A number in every lane."""
    if kind == _lanes:
        return value
    undefined = ir.Constant(_VECTOR, ir.Undefined)
    first = builder.insert_element(undefined, context.cast(builder, value, kind, types.float64), _INT(0))
    return builder.shuffle_vector(first, undefined, ir.Constant(ir.VectorType(_INT, LANES), [0] * LANES))


def _make_operator(function, instruction):
    """An operator between lanes, and between lanes and a number."""

    @infer_global(function)
    class _Template(AbstractTemplate):
        def generic(self, args, kws):
            known = all(isinstance(kind, _Lanes | types.Number) for kind in args)
            return signature(_lanes, *args) if _lanes in args and known else None

    def lower(context, builder, sig, args):
        spread = (_spread(context, builder, kind, value) for kind, value in zip(sig.args, args, strict=True))
        return getattr(builder, instruction)(*spread, flags=sorted(_FASTMATH))

    for kinds in ((_Lanes, _Lanes), (_Lanes, types.Number), (types.Number, _Lanes)):
        lower_builtin(function, *kinds)(lower)


for _functions, _instruction in (
    ((operator.add, operator.iadd), "fadd"), ((operator.sub, operator.isub), "fsub"),
    ((operator.mul, operator.imul), "fmul"), ((operator.truediv,), "fdiv"),
):  # fmt: skip
    for _function in _functions:
        _make_operator(_function, _instruction)


def _has_lanes(array, place):
    return array.ndim > (place.count if isinstance(place, types.BaseTuple) else 1)


def _address(context, builder, kinds, array, place):
    """Where the number, or the lanes, of a contiguous array lie at a place: an index, or (row, index)."""
    kind, where = kinds
    values = context.make_array(kind)(context, builder, array)
    if isinstance(where, types.BaseTuple):
        row, index = (builder.extract_value(place, k) for k in range(2))
        place = builder.add(builder.mul(row, builder.extract_value(values.shape, 1)), index)
    if not _has_lanes(kind, where):
        return builder.gep(values.data, [place])
    start = builder.gep(values.data, [builder.mul(place, place.type(LANES))])
    return builder.bitcast(start, ir.PointerType(_VECTOR))


@intrinsic
def at(typing, array, place):
    """``array[place]``, of arrays with one axis more the lanes there."""

    def lower(context, builder, sig, args):
        return builder.load(_address(context, builder, sig.args, *args), align=8)

    return (_lanes if _has_lanes(array, place) else types.float64)(array, place), lower


@intrinsic
def put(typing, array, place, value):
    """``array[place] = value``; a number goes into every lane."""

    def lower(context, builder, sig, args):
        *where, number = args
        *kinds, kind = sig.args
        if _has_lanes(*kinds):
            number = _spread(context, builder, kind, number)
        else:
            number = context.cast(builder, number, kind, types.float64)
        builder.store(number, _address(context, builder, kinds, *where), align=8)
        return context.get_dummy_value()

    return types.void(array, place, value), lower


@intrinsic
def _size(typing, number):
    """The absolute value, in each lane."""

    def lower(context, builder, sig, args):
        name = f"llvm.fabs.v{LANES}f64" if sig.args[0] == _lanes else "llvm.fabs.f64"
        shape = ir.FunctionType(args[0].type, [args[0].type])
        return builder.call(cgutils.get_or_insert_function(builder.module, shape, name), args)

    return number(number), lower


@intrinsic
def _less(typing, small, large):
    """1.0 in each lane where `small` is less, else, also where one is no number, 0.0; of numbers whether it is."""

    def lower(context, builder, sig, args):
        if sig.return_type == types.boolean:
            return builder.fcmp_ordered("<", *args)
        pair = (_spread(context, builder, kind, value) for kind, value in zip(sig.args, args, strict=True))
        return builder.uitofp(builder.fcmp_ordered("<", *pair), _VECTOR)

    return (_lanes if _lanes in (small, large) else types.boolean)(small, large), lower


@intrinsic
def _everywhere(typing, true):
    """Whether that is so in every lane."""

    def lower(context, builder, sig, args):
        if sig.args[0] == types.boolean:
            return args[0]
        zero = ir.Constant(_VECTOR, [0.0] * LANES)
        mask = builder.bitcast(builder.fcmp_ordered("!=", args[0], zero), ir.IntType(LANES))
        return builder.icmp_unsigned("==", mask, mask.type(2**LANES - 1))

    return types.boolean(true), lower


@intrinsic
def _turn(typing, lanes, start, rows):
    """A square from `start` on of an array (slots, LANES) into its transpose (LANES, slots): three rounds of swaps."""

    def lower(context, builder, sig, args):
        source, first, target = args
        kinds = sig.args
        vectors = []
        for k in range(LANES):
            place = builder.add(first, first.type(k))
            vectors.append(builder.load(_address(context, builder, kinds[:2], source, place), align=8))
        for half in (4, 2, 1):  # swap the off-diagonal blocks of this size
            low = [k if not k & half else LANES + k - half for k in range(LANES)]
            high = [k + half if not k & half else LANES + k for k in range(LANES)]
            for k in (k for k in range(LANES) if not k & half):
                pair = vectors[k], vectors[k + half]
                masks = (ir.Constant(ir.VectorType(_INT, LANES), order) for order in (low, high))
                vectors[k], vectors[k + half] = (builder.shuffle_vector(*pair, mask) for mask in masks)
        values = context.make_array(kinds[2])(context, builder, target)
        width = builder.extract_value(values.shape, 1)
        for k, vector in enumerate(vectors):
            place = builder.gep(values.data, [builder.add(builder.mul(width, width.type(k)), first)])
            builder.store(vector, builder.bitcast(place, ir.PointerType(_VECTOR)), align=8)
        return context.get_dummy_value()

    return types.void(lanes, start, rows), lower


@_inlined
def _room(n):
    """An array of at least n times LANES numbers: whole squares of them, so that they can be transposed."""
    return np.empty(((np.intp(n) + LANES - 1) // LANES * LANES, LANES))


# Side by side or one after the other: the axes of the state, or of what it reads, say which when a loop is compiled.


def _place(z, position):
    """Block of the table, and row of what is prepared, of a step."""


@overload(_place, inline="always")
def _place_of(z, position):
    if z.ndim == 3:
        return lambda z, position: (position, 0)
    return lambda z, position: (position // LANES, position % LANES)


def _rows(z, lanes):
    """What steps read of the array (slots, LANES): it, as (1, slots, LANES), or room for its transpose."""


@overload(_rows, inline="always")
def _rows_of(z, lanes):
    if z.ndim == 3:
        return lambda z, lanes: lanes.reshape((1, *lanes.shape))
    return lambda z, lanes: np.empty((LANES, lanes.shape[0]))


def _hand_over(lanes, rows):
    """What was prepared in lanes, to those who read it."""


@overload(_hand_over)
def _handed_over(lanes, rows):
    if rows.ndim == 3:
        return lambda lanes, rows: None

    def turned(lanes, rows):
        for block in range(rows.shape[1] // LANES):
            _turn(lanes, block * LANES, rows)

    return turned


@_inlined
def _affine_sum(packed, scalars, row, sums):
    """M, C, K and F at one row of the table: sum of scalar x constant."""
    runs = packed.runs
    data = packed.data
    for i in range(_THREE * packed.layout.n_slots + packed.layout.n):
        put(sums, i, 0.0)
    for k in range(runs.shape[0]):
        scalar = at(scalars, (row, runs[k, 0]))
        start = runs[k, 1]
        offset = runs[k, 3]
        for i in range(runs[k, 2]):
            put(sums, start + i, at(sums, start + i) + scalar * data[offset + i])


@_jit
def _factor(layout, lu, scale, good):
    """A = L U in place, without pivoting, reciprocal pivots on the diagonal.

    scale: of each row, sum of the absolute values of what was added up in the diagonal
    good: one number, 1.0 where no pivot vanishes, else 0.0
    """
    base = layout.base
    last = layout.last
    regular = _less(-1.0, at(scale, 0))
    for k in range(layout.n):
        row_k = base[k]
        pivot = at(lu, row_k + k)
        regular *= _less(_SMALLEST_PIVOT * at(scale, k), _size(pivot))
        reciprocal = 1.0 / pivot
        put(lu, row_k + k, reciprocal)
        for i in range(k + _ONE, last[k]):
            row_i = base[i]
            factor = at(lu, row_i + k) * reciprocal
            put(lu, row_i + k, factor)
            for j in range(k + _ONE, last[k]):
                put(lu, row_i + j, at(lu, row_i + j) - factor * at(lu, row_k + j))
    put(good, 0, regular)


@_inlined
def _solve(layout, lu, row, x, column):
    """Solve L U x = x for one row of `x`: by columns, because short sums wait for each other."""
    base = layout.base
    first = layout.first
    last = layout.last
    n = layout.n
    for j in range(n):
        known = at(x, (column, j))
        for i in range(j + _ONE, last[j]):
            put(x, (column, i), at(x, (column, i)) - at(lu, (row, base[i] + j)) * known)
    for back in range(n):
        j = n - _ONE - back
        known = at(x, (column, j)) * at(lu, (row, base[j] + j))
        put(x, (column, j), known)
        for i in range(first[j], j):
            put(x, (column, i), at(x, (column, i)) - at(lu, (row, base[i] + j)) * known)


@_inlined
def _unbalanced(layout, sums, row, load, z, z_row, v, column, i):
    """Row i of F - C v - K z."""
    c_row = layout.n_slots + layout.base[i]
    k_row = c_row + layout.n_slots
    force = load * at(sums, (row, _THREE * layout.n_slots + i))
    reaction = 0.0 * force  # two sums, for an addition waits for the one before it
    for j in range(layout.first[i], layout.last[i]):
        force -= at(sums, (row, c_row + j)) * at(v, (column, j))
        reaction += at(sums, (row, k_row + j)) * at(z, (z_row, j))
    return force - reaction


@_jit
def _mass_matrices(packed, scalars, row, sums, mass, scale, good):
    """All sums at one row of the table, and M factorised."""
    layout = packed.layout
    _affine_sum(packed, scalars, row, sums)
    for i in range(layout.n_slots):
        put(mass, i, at(sums, i))
    for i in range(layout.n):
        put(scale, i, _size(at(sums, layout.base[i] + i)))
    _factor(layout, mass, scale, good)


@_inlined
def _true_accelerations(layout, sums, mass, row, load, z, v, q, column):
    """q from M q = F - C v - K z."""
    for i in range(layout.n):
        put(q, (column, i), _unbalanced(layout, sums, row, load[column], z, column, v, column, i))
    _solve(layout, mass, row, q, column)


@_inlined
def _store(stored, out, z, v, q):
    """Row `out` of what is kept: the first column."""
    out_z, out_v, out_a = stored
    for i in range(z.shape[1]):
        put(out_z, (out, i), at(z, (0, i)))
        put(out_v, (out, i), at(v, (0, i)))
        put(out_a, (out, i), at(q, (0, i)))


@_jit
def accelerations(packed, scalars, load, z, v, q):
    """Fill `q` from the equation of motion, scalars of shape (1, n_scalars, LANES); False where M is singular."""
    layout = packed.layout
    sums, mass = _room(_THREE * layout.n_slots + layout.n), _room(layout.n_slots)
    scale, good = _room(layout.n), _room(1)
    _mass_matrices(packed, scalars, np.intp(0), sums, mass, scale, good)
    if not _everywhere(_less(0.0, at(good, 0))):
        return False
    sums_at, mass_at = _rows(z, sums), _rows(z, mass)
    _hand_over(sums, sums_at)
    _hand_over(mass, mass_at)
    for column in range(z.shape[0]):
        _true_accelerations(layout, sums_at, mass_at, 0, load, z, v, q, column)
    return True


@_jit
def _newmark_matrices(packed, scalars, row, c_weight, k_weight, sums, lu, scale, good):
    """All sums, and M + c_weight C + k_weight K factorised."""
    layout = packed.layout
    n_slots = layout.n_slots
    _affine_sum(packed, scalars, row, sums)
    for i in range(n_slots):
        stiffness = at(sums, n_slots + n_slots + i)
        put(lu, i, at(sums, i) + c_weight * at(sums, n_slots + i) + k_weight * stiffness)
    for i in range(layout.n):
        m = layout.base[i] + i
        c_part, k_part = c_weight * at(sums, n_slots + m), k_weight * at(sums, n_slots + n_slots + m)
        put(scale, i, _size(at(sums, m)) + _size(c_part) + _size(k_part))
    _factor(layout, lu, scale, good)


@_jit
def newmark(packed, scalars, period, position, n_steps, coefficients, load, state, done, every, bound, stored):
    """Newmark's family with weighted accelerations, unknown: the true acceleration q at the end of the step.

    With p = (alpha_f q_0 - alpha_m a_0) / (1 - alpha_m), known, and kappa = (1 - alpha_f) / (1 - alpha_m):

        a_1 = p + kappa q_1
        v_1 = v_0 + h ((1 - gamma) a_0 + gamma a_1)
        z_1 = z_0 + h v_0 + h^2 ((1/2 - beta) a_0 + beta a_1)
        (M + gamma h kappa C + beta h^2 kappa K) q_1 = F - C v_p - K z_p  at the end of the step,

    v_p and z_p being v_1 and z_1 less their share of q_1 (Arnold and Bruels 2007, section 2, whose
    accelerations satisfy the equation of motion; for constant M it is the method of Chung and Hulbert 1993).
    """
    layout, (z, v, a, q) = packed.layout, state
    n, n_slots = layout.n, layout.n_slots
    step, from_q, from_a, kappa, c_weight, k_weight, v_start, v_known, z_start, z_known = coefficients
    sums, lu, scale, good = _room(_THREE * n_slots + n), _room(n_slots), _room(n), _room(1)
    sums_at, lu_at, good_at = _rows(z, sums), _rows(z, lu), _rows(z, good)
    due = every - done % every
    out = done // every + 1
    for count in range(n_steps):
        block, row = _place(z, position)
        if row == 0 or count == 0:
            _newmark_matrices(packed, scalars, block, c_weight, k_weight, sums, lu, scale, good)
            _hand_over(sums, sums_at)
            _hand_over(lu, lu_at)
            _hand_over(good, good_at)
        if not _everywhere(_less(0.0, at(good_at, (row, 0)))):
            return count, SINGULAR
        for column in range(z.shape[0]):
            for i in range(n):
                here = (column, i)
                before, speed = at(a, here), at(v, here)
                known = from_q * at(q, here) + from_a * before
                put(z, here, at(z, here) + step * speed + z_start * before + z_known * known)
                put(v, here, speed + v_start * before + v_known * known)
                put(a, here, known)
            for i in range(n):
                put(q, (column, i), _unbalanced(layout, sums_at, row, load[column], z, column, v, column, i))
            _solve(layout, lu_at, row, q, column)
            squares = 0.0 * at(z, (column, 0))
            for i in range(n):
                here = (column, i)
                found = at(q, here)
                moved = at(z, here) + k_weight * found
                put(z, here, moved)
                put(v, here, at(v, here) + c_weight * found)
                put(a, here, at(a, here) + kappa * found)
                squares += moved * moved
            if not _everywhere(_less(squares, bound)):
                return count + 1, UNBOUNDED
        position += 1
        if position == period:
            position = 0
        due -= 1
        if due == 0:
            due = every
            _store(stored, out, z, v, q)
            out += 1
    return n_steps, COMPLETED


@_jit
def _gauss_matrices(packed, scalars, row, step, sums_1, sums_2, matrix, scale, good):
    """All sums at the stages; delta_sr M_s + h a_sr C_s + h^2 e_sr K_s at row (i, s), column (j, r), factorised."""
    layout, pairs = packed.layout, packed.pairs
    n_slots = layout.n_slots
    root = math.sqrt(3.0) / 6.0
    c_same, c_12, c_21 = 0.25 * step, (0.25 - root) * step, (0.25 + root) * step
    k_same, k_12, k_21 = step * step / 24.0, 0.5 * step * c_12, 0.5 * step * c_21
    _affine_sum(packed, scalars, row, sums_1)
    _affine_sum(packed, scalars, row + 1, sums_2)
    for i in range(layout.n):
        base = layout.base[i]
        row_1 = pairs.base[_TWO * i]
        row_2 = pairs.base[_TWO * i + _ONE]
        for j in range(layout.first[i], layout.last[i]):
            m, c, k = base + j, n_slots + base + j, n_slots + n_slots + base + j
            c_1, k_1, c_2, k_2 = at(sums_1, c), at(sums_1, k), at(sums_2, c), at(sums_2, k)
            put(matrix, row_1 + _TWO * j, at(sums_1, m) + c_same * c_1 + k_same * k_1)
            put(matrix, row_1 + _TWO * j + _ONE, c_12 * c_1 + k_12 * k_1)
            put(matrix, row_2 + _TWO * j, c_21 * c_2 + k_21 * k_2)
            put(matrix, row_2 + _TWO * j + _ONE, at(sums_2, m) + c_same * c_2 + k_same * k_2)
        m, c, k = base + i, n_slots + base + i, n_slots + n_slots + base + i
        for stage in range(_TWO):
            sums = sums_1 if stage == 0 else sums_2
            parts = _size(at(sums, m)) + _size(c_same * at(sums, c)) + _size(k_same * at(sums, k))
            put(scale, _TWO * i + stage, parts)
    _factor(pairs, matrix, scale, good)


@_jit
def gauss(packed, scalars, period, position, n_steps, coefficients, load, state, done, every, bound, stored):
    """Two-stage Gauss-Legendre (Hairer and Wanner 1996, table IV.5.1); unknowns: accelerations at the stages.

    With x_1, x_2 in M_s x_s + C_s v_s + K_s z_s = F_s at t + c_s h, the tableau's a_sr and e_sr = (A A)_sr:

        v_s = v_0 + h sum_r a_sr x_r,  z_s = z_0 + c_s h v_0 + h^2 sum_r e_sr x_r
        v_1 = v_0 + h/2 (x_1 + x_2),   z_1 = z_0 + h v_0 + h^2/2 ((1 - c_1) x_1 + (1 - c_2) x_2)

    The accelerations that are stored come from the equation of motion at the end of the step.
    """
    layout, pairs, (z, v, _, q) = packed.layout, packed.pairs, state
    n, n_slots = layout.n, layout.n_slots
    (step,) = coefficients
    v_weight = 0.5 * step
    z_weight_1, z_weight_2 = v_weight * step * _STAGE_2, v_weight * step * _STAGE_1  # 1 - c_1 = c_2
    sums_1, sums_2, sums_3 = _room(_THREE * n_slots + n), _room(_THREE * n_slots + n), _room(_THREE * n_slots + n)
    matrix, mass, scale = _room(pairs.n_slots), _room(n_slots), _room(_TWO * n)
    good, good_mass = _room(1), _room(1)
    sums_1_at, sums_2_at, sums_3_at = _rows(z, sums_1), _rows(z, sums_2), _rows(z, sums_3)
    matrix_at, mass_at, good_at, good_mass_at = _rows(z, matrix), _rows(z, mass), _rows(z, good), _rows(z, good_mass)
    at_stage, x = np.empty((1, *z.shape[1:])), np.empty((1, 2 * z.shape[1], *z.shape[2:]))
    due = every - done % every
    out = done // every + 1
    for count in range(n_steps):
        block, row = _place(z, position)
        if row == 0 or count == 0:
            _gauss_matrices(packed, scalars, 3 * block, step, sums_1, sums_2, matrix, scale, good)
            _hand_over(sums_1, sums_1_at)
            _hand_over(sums_2, sums_2_at)
            _hand_over(matrix, matrix_at)
            if due <= good_at.shape[0]:
                _mass_matrices(packed, scalars, 3 * block + 2, sums_3, mass, scale, good_mass)
                _hand_over(sums_3, sums_3_at)
                _hand_over(mass, mass_at)
                _hand_over(good_mass, good_mass_at)
            _hand_over(good, good_at)
        if not _everywhere(_less(0.0, at(good_at, (row, 0)))):
            return count, SINGULAR
        for column in range(z.shape[0]):
            for stage in range(_TWO):
                ahead = step * (_STAGE_1 if stage == 0 else _STAGE_2)
                sums = sums_1_at if stage == 0 else sums_2_at
                for i in range(n):
                    put(at_stage, (0, i), at(z, (column, i)) + ahead * at(v, (column, i)))
                for i in range(n):
                    rest = _unbalanced(layout, sums, row, load[column], at_stage, 0, v, column, i)
                    put(x, (0, _TWO * i + stage), rest)
            _solve(pairs, matrix_at, row, x, 0)
            squares = 0.0 * at(z, (column, 0))
            for i in range(n):
                here = (column, i)
                x_1, x_2, speed = at(x, (0, _TWO * i)), at(x, (0, _TWO * i + _ONE)), at(v, here)
                moved = at(z, here) + step * speed + z_weight_1 * x_1 + z_weight_2 * x_2
                put(z, here, moved)
                put(v, here, speed + v_weight * (x_1 + x_2))
                squares += moved * moved
            if not _everywhere(_less(squares, bound)):
                return count + 1, UNBOUNDED
        position += 1
        if position == period:
            position = 0
        due -= 1
        if due == 0:
            due = every
            if not _everywhere(_less(0.0, at(good_mass_at, (row, 0)))):
                return count, SINGULAR
            _true_accelerations(layout, sums_3_at, mass_at, row, load, z, v, q, 0)
            _store(stored, out, z, v, q)
            out += 1
    return n_steps, COMPLETED


@_jit
def exact_modal(packed, scalars, period, position, n_steps, coefficients, load, state, done, every, bound, stored):
    """Decoupled modes m z'' + c z' + k z = F, the paper's eq. (143) and damping; exact for F linear in t.

    coefficients: shape (n, 11), see `kaneflex.integrate.modal`. packed: the runs of F only, no slots. scalars: shape
    (period + 1, n_scalars), at the steps.
    """
    z, v, _, q = state
    n = z.shape[1]
    force_0, force_1 = np.empty(n), np.empty(n)
    _affine_sum(packed, scalars, position, force_0)
    due = every - done % every
    out = done // every + 1
    for count in range(n_steps):
        position += 1
        _affine_sum(packed, scalars, position, force_1)
        for column in range(z.shape[0]):
            squares = 0.0
            for i in range(n):
                z_0, v_0 = z[column, i], v[column, i]
                f_0, f_1 = load[column] * force_0[i], load[column] * force_1[i]
                w = coefficients[i]
                z_1 = w[0] * z_0 + w[1] * v_0 + w[2] * f_0 + w[3] * f_1
                v[column, i] = w[4] * z_0 + w[5] * v_0 + w[6] * f_0 + w[7] * f_1
                z[column, i] = z_1
                squares += z_1 * z_1
            if not squares <= bound:
                return count + 1, UNBOUNDED
        force_0, force_1 = force_1, force_0
        if position == period:
            position = 0
        due -= 1
        if due == 0:
            due = every
            for i in range(n):
                w = coefficients[i]
                q[0, i] = load[0] * w[8] * force_0[i] - w[9] * v[0, i] - w[10] * z[0, i]
            _store(stored, out, z, v, q)
            out += 1
    return n_steps, COMPLETED
