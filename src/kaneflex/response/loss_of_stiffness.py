"""What a run should say of a stiffness that its axial forces or its spin take away."""

from __future__ import annotations

import numpy as np

from kaneflex.multibody.model import Model
from kaneflex.response.buckling import load_factors

_INSTANTS = 36
"""Instants of a run that are looked at."""
_ROUNDING = 1e-13
"""Share of the highest squared frequency that rounding may leave of one that is zero."""
_MOST = 200
"""Coordinates up to which looking costs next to nothing beside a run; for more `kaneflex stability` is asked."""


def lost_stiffness(model: Model, times: np.ndarray) -> list[str]:
    """Warnings where K_s + K_g, or K_s + K_d where the run leaves K_g out, is not positive at some of ``times`` [s]."""
    options, size = model.options, model.equations.size
    if options.dynamics == "frozen":
        squares = model.kept["K"].at({}).diagonal()
        if not squares.min(initial=0.0) < -_ROUNDING * abs(squares).max(initial=0.0):
            return []
        rate = float(np.sqrt(-squares.min()))
        return [
            f"the spin takes away all stiffness where the matrices are frozen: a mode grows by exp({rate:.4g} t); K_g, "
            "by which the axial forces would restore it, is kept by preset stiffened"
        ]
    if options.dynamics not in ("dynamic", "quasistatic") or not 0 < size <= _MOST:
        return []
    if not options.geometric and not options.spin:
        return []
    rigid = model.motion.at(times[:: max(1, len(times) // _INSTANTS)])
    equations = model.equations
    more = equations.K_g if options.geometric else equations.K_d
    factors = load_factors(rigid.matrices(equations.K_s), rigid.matrices(more))
    if factors is None or not factors.min() < 1.0:
        return []
    at = f"t = {rigid.times[int(factors.argmin())]:.4g} s"
    if options.geometric:
        return [
            f"the axial forces exceed a buckling load at {at}: {factors.min():.3g} of them would do, if they stayed; "
            f"ask kaneflex stability whether the motion is stable"
        ]
    return [
        f"the spin takes away all stiffness at {at}, and K_g, by which the axial forces would restore it, is left out; "
        "keep it, as preset stiffened does"
    ]
