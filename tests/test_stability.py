"""Stability of the periodic equations: Mathieu's tongues, and what has no multipliers."""

import json
from functools import cache
from pathlib import Path

import numpy as np
import pytest
from runs import model
from scipy.optimize import brentq

from kaneflex.errors import SceneError
from kaneflex.stability.floquet import Multipliers, floquet_multipliers

MATHIEU = json.loads((Path(__file__).parent / "data" / "mathieu.json").read_text())["computed"]
"""Characteristic values (NIST DLMF 28.2), where y'' + (a - 2 q cos 2z) y = 0 changes from stable to unstable."""


@cache
def mathieu(a: float, *settings: str) -> Multipliers:
    """Multipliers over the coefficient's period pi of the scene whose first mode obeys Mathieu's equation, q = 1."""
    return floquet_multipliers(model("mathieu", "bar.elements=24", f"pull.value={a - 1.0!r}", *settings))


def boundary(near: float, sign: float, *settings: str) -> float:
    """Where the sum of the two multipliers is 2 (period pi) or -2 (period 2 pi): both are then 1, or both are -1."""
    return brentq(
        lambda a: mathieu(a, *settings).values.sum().real - 2.0 * sign, near - 0.002, near + 0.002, xtol=1e-8
    )


@pytest.mark.parametrize(("kind", "order"), [("a", 0), ("b", 1), ("a", 1), ("b", 2), ("a", 2), ("b", 3)])
def test_boundaries_of_mathieus_equation(kind, order):
    exact = float(MATHIEU["1"][kind][order if kind == "a" else order - 1])
    assert boundary(exact, 1.0 if order % 2 == 0 else -1.0) == pytest.approx(exact, abs=1e-6)


def test_boundary_of_a_strong_pulsation():
    exact = float(MATHIEU["5"]["a"][1])
    assert boundary(exact, -1.0, "pulse.law=-10 * cos(clock)") == pytest.approx(exact, abs=1e-6)


@pytest.mark.parametrize(("a", "unstable"), [(-0.5, True), (-0.3, False), (0.5, True), (1.8, True), (1.9, False)])
def test_tongues_of_mathieus_equation(a, unstable):
    """q = 1: below a_0 = -0.455, from b_1 = -0.110 to a_1 = 1.859, and between the two. Undamped: product one."""
    found = mathieu(a)
    assert found.unstable is unstable and found.settled
    assert np.prod(found.values) == pytest.approx(1.0, abs=1e-9)


def test_the_scene_as_it_is_shipped_grows_fourfold():
    assert floquet_multipliers(model("mathieu")).radius == pytest.approx(4.156, abs=1e-3)


def test_damping_shrinks_the_multipliers_by_what_it_takes():
    """With z' damped at the rate c, z = exp(-c t / 2) y, y'' + (a - c^2 / 4 - 2 q cos 2t) y = 0."""
    plain = mathieu(1.0)
    ratio, omega = 0.05, 1.0
    damped = mathieu(1.0 + (ratio * omega) ** 2, f"damping.modal.ratio={ratio}")
    assert damped.radius == pytest.approx(plain.radius * np.exp(-ratio * omega * np.pi), rel=1e-6)


def test_a_model_without_periodic_equations_is_refused():
    with pytest.raises(SceneError, match="has no elastic equations"):
        mathieu(1.0, "solve.preset=rigid")
    with pytest.raises(SceneError, match="there is no cycle"):
        mathieu(1.0, "solve.duration=1 s")
    with pytest.raises(SceneError, match=r"bar\.link\.P_0 is -2 at first and 2 a cycle later"):
        mathieu(1.0, "pulse.law=-2 * cos(t)")
