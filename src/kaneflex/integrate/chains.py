"""The compiled loop `newmark_chain`: Newmark's family for long chains of narrow band, see `kaneflex.integrate.sliced`.

It takes the arguments of `kaneflex.integrate.steppers.newmark`, with a Chain in the place of `packed`, and makes the
same steps. Where that one adds up M, C and K for LANES steps, this one adds up M + c C + k K alone, and multiplies C
and K by vectors as the sums of scalar x constant matrix that they are, NODES nodes at once.
"""

import numpy as np
from numba import njit

from kaneflex.integrate import lanes, matrices, strands
from kaneflex.integrate.lanes import FASTMATH, LANES, at, put_run, run_at, total
from kaneflex.integrate.matrices import COMPLETED, SINGULAR, UNBOUNDED, compiled
from kaneflex.integrate.strands import NODES, ROWS, WIDTH, factors, solve_strands, unbalanced
from kaneflex.stamp import made_of

_NODES, _SLOTS = np.uint64(NODES), np.uint64(ROWS * WIDTH)


@compiled
def _spread(chain, narrow):
    """Vectors of n unknowns in the chain's own order."""
    wide = np.zeros((narrow.shape[0], chain.width))
    for column in range(narrow.shape[0]):
        for i in range(narrow.shape[1]):
            for place in chain.places[:, i]:
                wide[column, place] = narrow[column, i]
    return wide


@compiled
def _gather(chain, wide, column, narrow, row):
    """The n unknowns of one of them."""
    for i in range(narrow.shape[1]):
        narrow[row, i] = wide[column, chain.places[0, i]]


@njit(cache=True, error_model="numpy", fastmath=FASTMATH, no_cfunc_wrapper=True)
@made_of(lanes.__file__, matrices.__file__, strands.__file__)
def newmark_chain(chain, scalars, period, position, n_steps, coefficients, load, state, done, every, bound, stored):
    """The steps of `kaneflex.integrate.steppers.newmark`, where they are explained."""
    step, from_q, from_a, kappa, c_weight = (
        at(coefficients, 0), at(coefficients, 1), at(coefficients, 2), at(coefficients, 3), at(coefficients, 4)
    )  # fmt: skip
    k_weight, v_start, v_known, z_start, z_known = (
        at(coefficients, 5), at(coefficients, 6), at(coefficients, 7), at(coefficients, 8), at(coefficients, 9)
    )  # fmt: skip
    z, v, a, q = _spread(chain, state[0]), _spread(chain, state[1]), _spread(chain, state[2]), _spread(chain, state[3])
    band_at = np.empty((LANES, 2 * chain.slices * _SLOTS))
    core_at = np.empty((LANES, (chain.core * chain.core + _NODES - 1) // _NODES * _NODES))
    good_at, middle, products = np.empty((LANES, LANES)), np.empty((1, chain.core)), np.empty(chain.products)
    runs = chain.width // _NODES
    due = every - done % every
    out = done // every + 1
    count, status = 0, COMPLETED
    while count < n_steps and status == COMPLETED:
        block, row = position // LANES, position % LANES
        if row == 0 or count == 0:
            factors(chain, scalars, block, band_at, core_at, good_at)
        if not good_at[row, 0] > 0.0:
            status = SINGULAR
            break
        for column in range(load.shape[0]):
            for run in range(runs):
                here = (column, run * _NODES)
                before, speed = run_at(a, here), run_at(v, here)
                known = from_q * run_at(q, here) + from_a * before
                put_run(z, here, run_at(z, here) + step * speed + z_start * before + z_known * known)
                put_run(v, here, speed + v_start * before + v_known * known)
                put_run(a, here, known)
            unbalanced(chain, scalars, block, row, load[column], z, v, q, column, products)
            solve_strands(chain, band_at, core_at, row, q, column, middle)
            squares = 0.0 * run_at(z, (column, 0))
            for run in range(runs):
                here = (column, run * _NODES)
                found = run_at(q, here)
                moved = run_at(z, here) + k_weight * found
                put_run(z, here, moved)
                put_run(v, here, run_at(v, here) + c_weight * found)
                put_run(a, here, run_at(a, here) + kappa * found)
                squares += moved * moved
            if not total(squares) < bound:
                status = UNBOUNDED
        count += 1
        position += 1
        if position == period:
            position = 0
        due -= 1
        if due == 0:
            due = every
            for wide, narrow in ((z, stored[0]), (v, stored[1]), (q, stored[2])):
                _gather(chain, wide, 0, narrow, out)
            out += 1
    for wide, narrow in ((z, state[0]), (v, state[1]), (a, state[2]), (q, state[3])):
        for column in range(load.shape[0]):
            _gather(chain, wide, column, narrow, column)
    return count, status
