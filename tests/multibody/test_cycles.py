"""The search for a motion that repeats, over maps of one number: each says how its start was found."""

import itertools
from types import SimpleNamespace

import numpy as np
import pytest

from kaneflex.integrate.outcome import Outcome
from kaneflex.multibody.time.error_bounds import Method
from kaneflex.multibody.time.shooting import Cycles


class Halving(Cycles):
    """P(x) = 1 + x / 2, which repeats at 2; ``tangent`` stands for dP/dx, and no cycle from beyond ``goes_on`` ends."""

    def __init__(self, tangent, goes_on=np.inf):
        engine = SimpleNamespace(contacts=(), holds=())
        equations = SimpleNamespace(measure=np.ones(1), shapes=np.zeros(1, bool), engine=engine)
        super().__init__(equations, np.array([0.0, 1.0]), Method("radau", 0.0, 1.0))
        self.tangent, self.goes_on = tangent, goes_on

    def run(self, start):
        return start, 1.0 + start / 2.0

    def completed(self, cycle):
        return cycle[0] <= self.goes_on

    def states(self, cycle, count):
        return cycle

    def apart(self, start, *others):
        return np.array([[other - start] for other in others])

    def repeats(self, cycle, left):
        return abs(cycle[1] - cycle[0]) < 1e-6

    def monodromy(self, cycle, pieces):
        if isinstance(self.tangent, Exception):
            raise self.tangent
        return np.array([[self.tangent]])

    def moved(self, start, x):
        return start + x[0]

    def end(self, cycle):
        return cycle[1]

    at = None


def test_newtons_method_needs_two_cycles_and_no_words():
    (start, _), verdict = Halving(0.5).repeated(0.0)
    assert start == pytest.approx(2.0, rel=0, abs=1e-12)
    assert verdict.message == "completed"


def test_where_the_equations_beside_it_have_no_solution_cycles_are_waited_for():
    # 1 / 2^k < 1e-6 after 20 cycles
    (start, _), verdict = Halving(np.linalg.LinAlgError("singular matrix")).repeated(0.0)
    assert start == pytest.approx(2.0, rel=0, abs=2e-6) and verdict.outcome is Outcome.COMPLETED
    assert "found by continuing for 20 cycles; Newton's method fails: singular matrix" in verdict.message


def test_where_a_start_leads_where_nothing_goes_on_the_last_cycle_is_waited_from():
    (start, _), verdict = Halving(0.9, goes_on=3.0).repeated(0.0)  # such a slope leads to 10
    assert start == pytest.approx(2.0, rel=0, abs=2e-6)
    assert "found by continuing for 20 cycles; Newton's method leads to a state without motion" in verdict.message


def test_a_motion_that_does_not_repeat_says_what_was_tried():
    class Turning(Halving):
        def run(self, start):
            return start, start + 1.0

    _, verdict = Turning(1.0).repeated(0.0)
    assert verdict.outcome is Outcome.NO_PERIODIC_STATE
    assert "still changes after 100 cycles; Newton's method fails: Singular matrix; add damping" in verdict.message


def test_a_neighbour_repeats_as_well_as_the_errors_of_its_steps_allow():
    """Of a cycle beside a known one more is asked, but not what steps with an error of 1e-7 can't give."""

    class Noisy(Halving):
        def __init__(self):
            super().__init__(0.5)
            self.judges, self.left, self.error = False, 1e-8, itertools.cycle([1e-7, -1e-7])

        def run(self, start):
            return start, 1.0 + start / 2.0 + next(self.error)

        def repeats(self, cycle, left):
            return abs(cycle[1] - cycle[0]) < left

    (start, _), verdict = Noisy().repeated(0.0)
    assert verdict.outcome is Outcome.COMPLETED and start == pytest.approx(2.0, rel=0, abs=1e-6)


def test_waiting_ends_where_no_motion_goes_on():
    cycle, verdict = Halving(np.linalg.LinAlgError("singular matrix"), goes_on=1.2).repeated(0.0)
    assert verdict is None and cycle[0] == pytest.approx(1.5)  # after 0 and 1
