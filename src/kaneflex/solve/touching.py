"""What contacts did in a run, in numbers: for its summary, and as labelled arrays."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from pydantic import Field

from kaneflex.multibody.impacts import COLUMNS, ContactRecord
from kaneflex.support.plain_table import PlainTable

if TYPE_CHECKING:
    from kaneflex.solve.solution import Solution
    from kaneflex.support.labelled import Entry

_ABOUT = {
    "begin": ("s", "instant at which the contact closes"),
    "end": ("s", "instant at which it opens; not a number where it lasts"),
    "approach": ("m/s", "speed at which the gap shrinks at the begin"),
    "separation": ("m/s", "speed at which the gap grows at the end"),
    "impulse": ("N s", "of the normal force"),
    "peak": ("N", "largest normal force"),
    "lost": ("J", "energy lost"),
}


class ContactSummary(PlainTable):
    """What a contact did over the run."""

    impacts: int = Field(description="how often it closed; results.nc lists all of them")
    fastest_m_s: float | None = Field(description="largest speed of approach, m/s; null without an impact")
    largest_force: float | None = Field(description="largest normal force, N; null without an impact")
    lost: float = Field(description="energy lost, J")
    rests_since_s: float | None = Field(
        description="instant from which on it stays closed to the end of the run, s; null where it is open there"
    )


def contact_summaries(solution: Solution) -> dict[str, ContactSummary]:
    """Every contact by name; none of a run by equations without them."""
    record = record_of(solution)
    found = {}
    for k, name in enumerate(() if record is None else record.names):
        impacts = record.of(name)
        found[name] = ContactSummary(
            impacts=len(impacts),
            fastest_m_s=max((impact.approach for impact in impacts), default=None),
            largest_force=max((impact.peak for impact in impacts), default=None),
            lost=float(record.lost[-1, k]),
            rests_since_s=next((impact.begin for impact in impacts if impact.lasts), None),
        )
    return found


def labelled_contacts(solution: Solution) -> tuple[dict[str, Entry], dict[str, Entry]]:
    """Coordinates and variables: ``contact_gap`` and the like over time and ``contact``, ``impact_begin`` and the like
    over ``impact``; ``clearance_x`` and the like over time and ``clearance``."""
    record = record_of(solution)
    if record is None:
        return {}, {}
    both = ("time", "contact")
    variables: dict[str, Entry] = {
        "contact_gap": (both, record.gap, {
            "units": "m", "long_name": "gap between the sides of a contact",
            "comment": "below zero by how deep they are in each other; of a circle in a circle the clearance less the "
            "eccentricity",
        }),
        "contact_force": (both, record.force, {"units": "N", "long_name": "normal force of a contact"}),
        "contact_lost": (both, record.lost, {"units": "J", "long_name": "energy that a contact has lost so far"}),
    }  # fmt: skip
    if record.impacts:
        number = [record.names.index(impact.contact) for impact in record.impacts]
        about = {"long_name": "number of its contact, from 0 on, among those of the coordinate contact"}
        variables["impact_contact"] = ("impact", np.array(number, np.int32), about)
        for key in COLUMNS:
            unit, meaning = _ABOUT[key]
            values = np.array([getattr(impact, key) for impact in record.impacts])
            variables[f"impact_{key}"] = ("impact", values, {"units": unit, "long_name": meaning})
    coordinates: dict[str, Entry] = {"contact": ("contact", np.array(record.names), {"long_name": "contacts"})}
    loose = solution.model.scene.loose
    if loose:
        coordinates["clearance"] = ("clearance", np.array(list(loose)), {"long_name": "joints with a clearance"})
        variables |= _in_clearances(solution)
    return coordinates, variables


def eccentricity(solution: Solution, name: str) -> np.ndarray:
    """Of a pin or a block in its clearance, (n_times,): 0 in the middle, 1 where it touches, more by how deep it is.

    That of a block is that of the corner which is nearest to its face.
    """
    loose = solution.model.scene.loose[name]
    gaps = np.array([solution.motion.contact(key)[0] for key in loose.contacts])
    return 1.0 - gaps.min(axis=0) / loose.room


def _in_clearances(solution: Solution) -> dict[str, Entry]:
    """Where pins and blocks are in their clearances."""
    both, names = ("time", "clearance"), list(solution.model.scene.loose)
    places = np.array([solution.motion.clearance(name) for name in names])
    about = {
        "clearance_x": ("m", "place of a pin in its bearing along x, global; of a block along its guide"),
        "clearance_y": ("m", "place of a pin in its bearing along y, global; of a block across its guide"),
        "clearance_angle": ("rad", "angle of a pin's body against its bearing's; tilt of a block in its guide"),
    }
    found: dict[str, Entry] = {
        key: (both, places[:, k].T, {"units": unit, "long_name": meaning})
        for k, (key, (unit, meaning)) in enumerate(about.items())
    }
    ratio = np.array([eccentricity(solution, name) for name in names]).T
    meaning = "eccentricity: 0 in the middle of a clearance, 1 where its sides touch"
    return found | {"eccentricity": (both, ratio, {"units": "1", "long_name": meaning})}


def record_of(solution: Solution) -> ContactRecord | None:
    """What the contacts of a run did; None of one without, by equations without them, or that stopped at its start."""
    record = getattr(solution.trajectory, "contacts", None)
    return record if record is not None and record.names and len(record.gap) else None
