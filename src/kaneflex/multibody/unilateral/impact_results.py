"""Contact results of a run: gaps, forces and losses over time, and every impact."""

from __future__ import annotations

import math
from dataclasses import dataclass, fields, replace
from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from kaneflex.multibody.engine import Engine


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
    x, y : float
        Global position [m] of the contact at its begin; 0 for flanks, which have none.
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

    @property
    def lasts(self) -> bool:
        """True if it is closed at the end of the run."""
        return math.isnan(self.end)


@dataclass(frozen=True, eq=False)
class ContactRecord:
    """Contacts of a run at its stored instants.

    Attributes
    ----------
    names : tuple of str
    gap : ndarray (n_times, n_contacts)
        Gap [m], negative for penetration.
    force : ndarray (n_times, n_contacts)
        Normal forces [N], positive for compression.
    lost : ndarray (n_times, n_contacts)
        Energy [J] that each has lost since the start.
    begun : ndarray (n_times, n_contacts + n_switches)
        State of each contact: 0 open, the approach speed [m/s] of its law if closed, negative after it has let go; then
        the side of zero of each switching argument.
    impacts : tuple of Impact
        Impacts in the order of their ends; unfinished ones come last.
    """

    names: tuple[str, ...]
    gap: np.ndarray
    force: np.ndarray
    lost: np.ndarray
    begun: np.ndarray
    impacts: tuple[Impact, ...] = ()

    def taken(self, instants: np.ndarray) -> ContactRecord:
        """The same at some of the stored instants, with all impacts."""
        picked = {key: getattr(self, key)[instants] for key in ("gap", "force", "lost", "begun")}
        return replace(self, **picked)

    def of(self, name: str) -> tuple[Impact, ...]:
        """Impacts of one contact."""
        return tuple(impact for impact in self.impacts if impact.contact == name)


def over(names: tuple[str, ...], taken: np.ndarray) -> tuple[Impact, ...]:
    """Impacts recorded by the engine, (impacts, IMPACT_SIZE)."""
    return tuple(Impact(names[int(row[0])], *map(float, row[1:])) for row in taken)


def lasting(names: tuple[str, ...], engine: Engine, state: np.ndarray) -> tuple[Impact, ...]:
    """Unfinished impacts at a row of a run, whose motion the engine has."""
    from kaneflex.multibody.model import layout as at

    found, works = [], state[len(state) - len(engine.contacts) :]
    for name, work, numbers in zip(names, works, engine.contacts, strict=False):
        if numbers[at.BEGUN_AT]:
            lost = float(work - numbers[at.LOST_BEFORE] - numbers[at.ELASTIC])
            parts = numbers[[at.APPROACH, at.IMPULSE, at.PEAK]].tolist()
            place = numbers[[at.BEGAN_X, at.BEGAN_Y]].tolist()
            found.append(Impact(name, float(numbers[at.SINCE]), math.nan, parts[0], math.nan, *parts[1:], lost, *place))
    return tuple(found)


COLUMNS = tuple(field.name for field in fields(Impact))[1:]
"""Numbers of an impact."""
