"""Library of the compiled engine's functions for Python, compiled once per machine and called by address.

Numba optimises a compiled function again within each function that contains it, so that several cached functions would
each compile the whole engine. Here a single function contains all entries and returns their addresses; arrays are
passed by address, so that a call takes a few microseconds.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import cache
from typing import Any

from numba import njit

from kaneflex.generated import body, contact, friction, joints
from kaneflex.multibody.compile import addresses, stand_ins, values
from kaneflex.multibody.compile.addresses import called, entered
from kaneflex.multibody.dynamics import (
    algebra,
    articulated,
    change_points,
    courses,
    dense_lu,
    dimensions,
    forces,
    kinematics,
    load_derivatives,
    loop_closure,
    loop_condition,
    loop_factors,
    planar_tree,
    powers,
    reduction,
    tree,
    unfolding,
)  # fmt: skip
from kaneflex.multibody.model import layout
from kaneflex.multibody.model.layout import CONTACT_MECHANISM, HOLD_MECHANISM, MECHANISM, OUTER, Handed
from kaneflex.multibody.time import coefficients, collocation, event_location, stage_residuals, state_record, step_curve
from kaneflex.multibody.unilateral import (
    complementarity,
    contact_linearisation,
    contact_numbers,
    contacts,
    discontinuous_loads,
    dry_friction,
    friction_powers,
    impact,
    impulse_response,
    lugre,
    lugre_step,
    rigid_friction,
    stick_slip,
)  # fmt: skip
from kaneflex.support import inner
from kaneflex.support.fingerprint import made_of

_made_of_parts = made_of(
    addresses.__file__, algebra.__file__, articulated.__file__, body.__file__, change_points.__file__,
    coefficients.__file__, collocation.__file__, complementarity.__file__, contact.__file__,
    contact_linearisation.__file__, contact_numbers.__file__, contacts.__file__, courses.__file__, dense_lu.__file__,
    dimensions.__file__, discontinuous_loads.__file__, dry_friction.__file__, event_location.__file__, forces.__file__,
    friction.__file__, friction_powers.__file__, impact.__file__, impulse_response.__file__, inner.__file__,
    joints.__file__, kinematics.__file__, layout.__file__, load_derivatives.__file__, loop_closure.__file__,
    loop_condition.__file__, loop_factors.__file__, lugre.__file__, lugre_step.__file__, planar_tree.__file__,
    powers.__file__, reduction.__file__, rigid_friction.__file__, stage_residuals.__file__, stand_ins.__file__,
    state_record.__file__, step_curve.__file__, stick_slip.__file__, tree.__file__, unfolding.__file__, values.__file__,
)  # fmt: skip
ENTRIES = collocation.ENTRIES | unfolding.ENTRIES | reduction.ENTRIES
_plain, _with_contacts, _with_holds = (
    entered(each, ENTRIES) for each in (MECHANISM, CONTACT_MECHANISM, HOLD_MECHANISM)
)


@njit(cache=True, **OUTER)
@_made_of_parts
def _addresses():
    return _plain()


@njit(cache=True, **OUTER)
@_made_of_parts
def _addresses_with_contacts():
    return _with_contacts()


@njit(cache=True, **OUTER)
@_made_of_parts
def _addresses_with_holds():
    return _with_holds()


_ENTERED = {
    MECHANISM: _addresses, CONTACT_MECHANISM: _addresses_with_contacts, HOLD_MECHANISM: _addresses_with_holds,
}  # fmt: skip


@cache
def library(mechanism: Handed) -> dict[Any, Callable[..., Any]]:
    """C functions of all entries, by their numba functions; all compiled on the first call.

    ``mechanism``: the argument type; those with contacts or holds have more functions.
    """
    return called(_ENTERED[mechanism], ENTRIES)
