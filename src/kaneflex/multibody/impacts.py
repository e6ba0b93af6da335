"""What the contacts of a run did: their gaps, forces and losses over time, and every impact."""

from __future__ import annotations

import math
from dataclasses import dataclass, fields, replace
from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from kaneflex.multibody.engine import Engine


@dataclass(frozen=True)
class Impact:
    """A contact from when it closed to when it opened.

    Attributes
    ----------
    contact : str
    begin, end : float
        Instants [s]; no number is the end of one that lasts beyond the run.
    approach, separation : float
        Speeds [m/s] at which the gap shrinks at its begin and grows at its end.
    impulse : float
        Of its normal force [N s].
    peak : float
        Largest normal force [N].
    lost : float
        Energy [J].
    x, y : float
        Global place [m] of the contact at its begin; of flanks, which have none, 0.
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
        """Whether it is closed where the run ends."""
        return math.isnan(self.end)


@dataclass(frozen=True, eq=False)
class ContactRecord:
    """The contacts of a run at its stored instants.

    Attributes
    ----------
    names : tuple of str
    gap : ndarray (n_times, n_contacts)
        [m], below zero where the sides are in each other.
    force : ndarray (n_times, n_contacts)
        Normal forces [N] that push the sides apart.
    lost : ndarray (n_times, n_contacts)
        Energy [J] that each has lost since the start.
    begun : ndarray (n_times, n_contacts + n_switches)
        0 where a contact is open, the speed of approach [m/s] of its law where it is closed, below zero where it has
        let go; then of what switches laws on which side of zero it is.
    impacts : tuple of Impact
        In the order of their ends; those that last come last.
    """

    names: tuple[str, ...]
    gap: np.ndarray
    force: np.ndarray
    lost: np.ndarray
    begun: np.ndarray
    impacts: tuple[Impact, ...] = ()

    def taken(self, instants: np.ndarray) -> ContactRecord:
        """The same at some of the stored instants; the impacts are all."""
        picked = {key: getattr(self, key)[instants] for key in ("gap", "force", "lost", "begun")}
        return replace(self, **picked)

    def of(self, name: str) -> tuple[Impact, ...]:
        """The impacts of one contact."""
        return tuple(impact for impact in self.impacts if impact.contact == name)


def over(names: tuple[str, ...], taken: np.ndarray) -> tuple[Impact, ...]:
    """The impacts that the engine has kept, (impacts, IMPACT_SIZE)."""
    return tuple(Impact(names[int(row[0])], *map(float, row[1:])) for row in taken)


def lasting(names: tuple[str, ...], engine: Engine, here: np.ndarray) -> tuple[Impact, ...]:
    """The impacts that go on where a run stands: at a row of it, whose motion the engine has."""
    from kaneflex.multibody import tables as at

    found, works = [], here[len(here) - len(engine.contacts) :]
    for name, work, numbers in zip(names, works, engine.contacts, strict=False):
        if numbers[at.BEGUN_AT]:
            lost = float(work - numbers[at.LOST_BEFORE] - numbers[at.ELASTIC])
            parts = numbers[[at.APPROACH, at.IMPULSE, at.PEAK]].tolist()
            place = numbers[[at.BEGAN_X, at.BEGAN_Y]].tolist()
            found.append(Impact(name, float(numbers[at.SINCE]), math.nan, parts[0], math.nan, *parts[1:], lost, *place))
    return tuple(found)


COLUMNS = tuple(field.name for field in fields(Impact))[1:]
"""Numbers of an impact."""
