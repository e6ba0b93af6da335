"""Contact problems of complementarity: a solution is found in any units, order and rounding, or there is none."""

import itertools
import types

import numpy as np
import pytest

from kaneflex.multibody.dynamics import dense_lu
from kaneflex.multibody.model import codes, layout
from kaneflex.multibody.unilateral import complementarity

ROWS_AT = {name: getattr(codes, name) for name in ("WANTED", "MAY", "RATIO", "BESIDE", "PRESSES")}


@pytest.fixture(scope="module")
def complement():
    """The functions as Python runs them, without a mechanism's tables."""
    text, lu = dict(vars(complementarity)), dict(vars(dense_lu))
    for each in (text, lu):
        for name, function in list(each.items()):
            if hasattr(function, "py_func"):
                each[name] = types.FunctionType(function.py_func.__code__, each, name)
        each["apart"] = lambda: None
    text |= {"larger": max, "most": lambda m: m.rows, "listed": lambda m: 0, "dense_lu": types.SimpleNamespace(**lu)}
    text["vector"] = lambda m, which: m.rows * (m.rows + which)

    def solved(problem):
        W, gaps, slips, given = problem
        rows = gaps + slips
        m = types.SimpleNamespace(rows=rows, plan={layout.COMPLEMENT: 0}, pivots=np.zeros(9 * rows, int))
        m.w = np.zeros(codes.room_of(gaps, slips))
        m.w[: rows * rows] = W.ravel()
        for name, values in given.items():
            m.w[text["vector"](m, ROWS_AT[name]) :][:rows] = values
        found = text["complement"](m, codes.FORCES, codes.ACCELERATIONS, gaps, slips)
        answer = (codes.FORCES, codes.ACCELERATIONS)
        return tuple(m.w[text["vector"](m, k) :][:rows].copy() for k in answer) if found else None

    return solved


def contacts_of(rng, kind):
    """A body of some freedoms between contacts with friction, in all degrees of redundancy, that move at random."""
    gaps, freedoms = rng.integers(1, 4), rng.integers(1, 4)
    slips = rng.integers(0, gaps + 1)
    A = rng.normal(size=(freedoms, freedoms))
    mobility = A @ A.T + 0.1 * np.eye(freedoms)
    J, v = rng.normal(size=(gaps + slips, freedoms)), rng.normal(size=freedoms)
    if kind == "twice" and gaps > 1:
        J[1] = J[0]
    if kind == "whole":
        J, v, mobility = rng.integers(-2, 3, J.shape) * 1.0, rng.integers(-2, 3, freedoms) * 1.0, np.eye(freedoms)
    zero, b = np.zeros(gaps + slips), J @ v
    b[:gaps] *= np.where(b[:gaps] < 0, 1 + rng.choice([0, 0.5, 1]), 1.0)
    presses, ratio = zero - 1, zero.copy()
    presses[gaps:], ratio[gaps:] = rng.permutation(gaps)[:slips], rng.choice([0.1, 0.5, 1, 2], slips)
    given = {"WANTED": b, "MAY": zero + 1, "RATIO": ratio, "BESIDE": zero, "PRESSES": presses}
    return J @ mobility @ J.T, int(gaps), int(slips), given


def transformed(rng, problem):
    """The same problem by other units, another order and other rounding; how to have its answer as the first one's."""
    W, gaps, slips, given = problem
    unit = np.exp(rng.uniform(-15, 15)) * np.where(np.arange(gaps + slips) < gaps, 1.0, np.exp(rng.uniform(-5, 5)))
    order = np.r_[rng.permutation(gaps), gaps + rng.permutation(slips)].astype(int)
    back, presses = np.argsort(order), given["PRESSES"].astype(int)
    W = (W * np.outer(unit, unit))[np.ix_(order, order)] * (1 + 1e-15 * rng.normal(size=W.shape))
    changed = {
        "WANTED": given["WANTED"] * unit, "MAY": given["MAY"], "BESIDE": given["BESIDE"],
        "RATIO": np.where(presses < 0, 0.0, given["RATIO"] * unit[presses] / unit),
        "PRESSES": np.where(presses < 0, -1, back[presses]),
    }  # fmt: skip
    changed = {name: values[order] for name, values in changed.items()}
    return (W, gaps, slips, changed), lambda x, u: (x[back] * unit, u[back] / unit)


def missed(problem, x, u):
    """By how much an answer misses the laws of gaps and slips, as a share of what is given and found."""
    W, gaps, _, given = problem
    scale = np.sqrt(np.diag(W)) + 1e-300
    limit = given["RATIO"] * np.maximum(x[given["PRESSES"].astype(int)], 0.0)
    x, u, limit = x * scale, u / scale, limit * scale
    size = max(abs(given["WANTED"] / scale).max(), abs(x).max(), 1e-300)
    n, t = slice(None, gaps), slice(gaps, None)
    slides = np.minimum(abs(u[t]), abs(x[t] + np.sign(u[t]) * limit[t]))
    off = np.r_[-x[n], -u[n], np.minimum(abs(x[n]), abs(u[n])), abs(x[t]) - limit[t], slides]
    return off.max() / size


@pytest.mark.parametrize("kind", ["any", "twice", "whole"])
def test_a_problem_is_solved_in_any_units_order_and_rounding(complement, kind, exhaustive):
    """Lemke's method alone found no solution in one order of some of them, and one in another order."""
    rng = np.random.default_rng({"any": 3, "twice": 1, "whole": 2}[kind])
    for _ in range(200 if exhaustive else 100):
        problem = contacts_of(rng, kind)
        answers = [complement(problem)]
        for _ in range(3):
            other, back = transformed(rng, problem)
            found = complement(other)
            answers.append(found and back(*found))
        assert len({answer is None for answer in answers}) == 1, problem
        assert all(missed(problem, *answer) < 1e-8 for answer in answers if answer), problem


def by_trial(problem):
    """Whether some choice of modes solves a problem of one contact with friction, by hand."""
    W, _, _, given = problem
    (b_n, b_t), mu = given["WANTED"], given["RATIO"][1]
    if b_n >= 0:
        return True
    for sign, row in itertools.product((1, -1), (0, 1)):
        if row and np.linalg.det(W) > 1e-9:
            x_n, x_t = np.linalg.solve(W, [-b_n, -b_t])
            if x_n >= 0 and abs(x_t) <= mu * x_n:
                return True
        x_n = -b_n / (W[0, 0] - sign * mu * W[0, 1])
        if x_n >= 0 and sign * (b_t + (W[1, 0] - sign * mu * W[1, 1]) * x_n) >= 0:
            return True
    return False


def test_a_paradox_is_one_by_hand(complement):
    """Painleve's: where no force agrees the answer is None, whatever the units, and only there."""
    rng, counts = np.random.default_rng(5), [0, 0]
    for _ in range(200):
        W = np.array([[1.0, rng.uniform(0, 0.95)], [0, 1.0]])
        W[1, 0] = W[0, 1]
        b = np.array([-1.0, rng.normal()])
        given = {"MAY": np.ones(2), "RATIO": np.array([0, rng.uniform(0, 3)]), "BESIDE": np.zeros(2),
                 "PRESSES": np.array([-1.0, 0.0]), "WANTED": b}  # fmt: skip
        # a contact that slides: its normal force brings its friction along, and there is no row of the slip
        sliding = np.array([[W[0, 0] - given["RATIO"][1] * W[0, 1]]])
        alone = {name: values[:1] for name, values in given.items()}
        if abs(sliding[0, 0]) > 1e-6:
            assert (complement((sliding, 1, 0, alone)) is None) == (sliding[0, 0] < 0)
            counts[int(sliding[0, 0] < 0)] += 1
        assert (complement((W, 1, 1, given)) is not None) == by_trial((W, 1, 1, given))
    assert min(counts) > 20
