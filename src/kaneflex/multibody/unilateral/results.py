"""Results of unilateral and frictional rows over a run, and every impact."""

from __future__ import annotations

import math
from dataclasses import dataclass, field, fields
from typing import TYPE_CHECKING

import numpy as np

from kaneflex.multibody.model import layout as at

if TYPE_CHECKING:
    from kaneflex.multibody.engine import Engine

_NONE = np.zeros(0)


@dataclass(frozen=True)
class Impact:
    """A contact from its closing to its opening.

    Attributes
    ----------
    contact : str
    begin, end : float
        Instants [s]; the end is NaN if it lasts beyond the run.
    approach, separation : float
        Speeds [m/s] at which the gap shrinks at its begin and grows at its end.
    impulse : float
        Impulse of its normal force [N s].
    peak : float
        Largest normal force [N].
    lost : float
        Energy lost [J].
    x, y, z : float
        Global position [m] of the contact at its begin; z is 0 in the plane.
    """

    contact: str
    begin: float
    end: float
    approach: float
    separation: float
    impulse: float
    peak: float
    lost: float
    x: float
    y: float
    z: float

    @property
    def lasts(self) -> bool:
        """True if it is closed at the end of the run."""
        return math.isnan(self.end)


@dataclass(frozen=True, eq=False)
class RowRecord:
    """Contacts, or frictions, of a run at its stored instants.

    Attributes
    ----------
    names : tuple of str
        Contacts; for frictions their joints and contacts.
    gap : ndarray (n_times, n_rows)
        Gap [m], negative for penetration; for a friction its position.
    speed : ndarray (n_times, n_rows)
        Rate of the gap; for a friction the speed of the second side past the first, along a guide's direction, or a
        contact's normal turned by 90 deg [m/s or rad/s].
    force : ndarray (n_times, n_rows)
        Normal forces [N], positive for compression; for a friction on the second side, in a pin on the second body
        [N m], along the same.
    pressed : ndarray (n_times, n_rows)
        What presses the sides together: a contact's force [N], a pin's reaction times its radius [N m], the sum of what
        a guide's faces bear [N].
    lost : ndarray (n_times, n_rows)
        Energy [J] that each has lost since the start.
    mode : ndarray (n_times, n_rows)
        OPEN, CLOSED, RELEASED, STICKING, SLIPPING, FLOWING or BENDING, see :mod:`kaneflex.multibody.model.layout`.
    bristles : ndarray (n_times, n_rows)
        Deflection of the bristles of law lugre [m, in a pin rad]; 0 for other laws.
    impacts : tuple of Impact
        Impacts in the order of their ends; unfinished ones come last.
    jams : ndarray (n_rows,)
        First time [s] at which friction jammed its contact: rigid sides would have no consistent contact force, or
        several (Painleve's paradox); NaN without jamming.
    """

    names: tuple[str, ...]
    gap: np.ndarray
    speed: np.ndarray
    force: np.ndarray
    pressed: np.ndarray
    lost: np.ndarray
    mode: np.ndarray
    bristles: np.ndarray
    impacts: tuple[Impact, ...] = ()
    jams: np.ndarray = field(default_factory=lambda: _NONE)

    @classmethod
    def of(
        cls, names: tuple[str, ...], states: np.ndarray, lost: np.ndarray, impacts: tuple[Impact, ...] = (),
        jams: np.ndarray = _NONE,
    ) -> RowRecord:  # fmt: skip
        """Record from the engine's results of each row, (n_times, n_rows, RESULTS), their losses, impacts and jams."""
        gap, speed, force, pressed, _, mode, memory = states.transpose(2, 0, 1)
        bristles = np.where(mode == at.BENDING, memory, 0.0)
        return cls(names, gap, speed, force, pressed, lost, mode, bristles, impacts, jams)

    def impacts_of(self, name: str) -> tuple[Impact, ...]:
        """Impacts of one contact."""
        return tuple(impact for impact in self.impacts if impact.contact == name)


def over(names: tuple[str, ...], taken: np.ndarray) -> tuple[Impact, ...]:
    """Impacts recorded by the engine, (impacts, IMPACT_SIZE)."""
    return tuple(Impact(names[int(row[0])], *map(float, row[1:])) for row in taken)


def lasting(names: tuple[str, ...], engine: Engine, state: np.ndarray) -> tuple[Impact, ...]:
    """Unfinished impacts at a row of a run, whose motion the engine has."""
    found, works = [], state[len(state) - len(engine.contacts) :]
    for name, work, numbers in zip(names, works, engine.contacts, strict=False):
        if numbers[at.MODE] != at.OPEN:
            since, approach, impulse, peak, before, *place = numbers[at.SINCE : at.NODES].tolist()
            lost = float(work - before - numbers[at.STORED])
            found.append(Impact(name, since, math.nan, approach, math.nan, impulse, peak, lost, *place))
    return tuple(found)


COLUMNS = tuple(each.name for each in fields(Impact))[1:]
"""Numbers of an impact."""
