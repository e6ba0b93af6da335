"""Results of contacts and friction of a run: for its summary, as labelled arrays, and where contact lines of elastic
links, which are straight tangents at their address, are not valid."""

from __future__ import annotations

from collections.abc import Iterator
from typing import TYPE_CHECKING

import numpy as np

from kaneflex.mechanism.planar import BodyPoint
from kaneflex.scene.contacts import Contact
from kaneflex.support.errors import SceneError

if TYPE_CHECKING:
    from kaneflex.multibody.model.bound_model import Model
    from kaneflex.multibody.unilateral.results import RowRecord
    from kaneflex.solve.run_result import RunResult
    from kaneflex.solve.summary_tables import ContactSummary, FrictionSummary
    from kaneflex.support.labelled import Entry

_ABOUT = {
    "begin": ("s", "s", "instant at which the contact closes"),
    "end": ("s", "s", "instant at which it opens; NaN if it lasts"),
    "approach": ("m/s", "rad/s", "speed at which the gap shrinks at the beginning"),
    "separation": ("m/s", "rad/s", "speed at which the gap grows at the end"),
    "impulse": ("N s", "N m s", "impulse of the normal force"),
    "peak": ("N", "N m", "largest normal force"),
    "lost": ("J", "J", "energy lost"),
    "x": ("m", "global position of the contact at the beginning, along x"),
    "y": ("m", "the same along y"),
    "z": ("m", "the same along z"),
}
"""Numbers of an impact: unit, unit for flanks (which have no place), and meaning."""
_STILL = 1e-9
"""Share of a friction's largest speed below which it is at rest."""
_SHARE = 0.01
"""Distance of a contact line from the link's axis that is accepted, as a share of the link's deflection."""
_NEAR = 0.05
"""Distance from the address, as a share of the link's length L, within which the line is that close: a constant
curvature k leaves k s^2/2 between tangent and axis at a distance s, and deflects the link by k L^2/8; 4 (s/L)^2 =
0.01."""
_TOUCHING = 1e-3
"""Gap at the start, as a share of the link's length, that counts as contact."""


def contact_summaries(solution: RunResult) -> dict[str, ContactSummary]:
    """Summary of every contact by name; empty if the equations have no contacts."""
    from kaneflex.solve.summary_tables import ContactSummary  # which loading does not need

    record, found = record_of(solution), {}
    for k, name in enumerate(() if record is None else record.names):
        impacts, turns = record.impacts_of(name), solution.model.scene.contacts[name].kind == "angle"
        fastest = max((impact.approach for impact in impacts), default=None)
        largest = max((impact.peak for impact in impacts), default=None)
        found[name] = ContactSummary(
            impacts=len(impacts),
            fastest_m_s=None if turns else fastest,
            largest_force=None if turns else largest,
            fastest_rad_s=fastest if turns else None,
            largest_torque=largest if turns else None,
            lost=float(record.lost[-1, k]),
            rests_since_s=next((impact.begin for impact in impacts if impact.lasts), None),
        )
    return found


def friction_summaries(solution: RunResult) -> dict[str, FrictionSummary]:
    """Summary of every friction by the name of its joint or contact."""
    from kaneflex.solve.summary_tables import FrictionSummary

    record, found = _rubbing(solution), {}
    for k, name in enumerate(() if record is None else record.names):
        assert record is not None
        turns, largest = solution.model.scene.turns_at(name), float(abs(record.force[:, k]).max())
        found[name] = FrictionSummary(
            lost=record.lost[-1, k],
            largest_force=None if turns else largest,
            largest_torque=largest if turns else None,
            stuck=float(_stuck(record)[:, k].mean()),
            jams_at_s=None if np.isnan(record.jams[k]) else record.jams[k],
            worn=None if solution.model.scene.frictions[name].wear is None else worn_volume(solution, name)[-1],
        )
    return found


def worn_volume(solution: RunResult, name: str) -> np.ndarray:
    """Volume [m^3] that a friction has worn off since the start, (n_times,): `wear` times the integral of the normal
    force over the sliding distance (Archard 1953), which is the work of sliding friction over `mu`."""
    record, friction = _rubbing(solution), solution.model.scene.frictions[name]
    assert record is not None and friction.wear is not None
    return friction.wear / friction.mu * record.lost[:, record.names.index(name)]


def sticks(solution: RunResult, name: str) -> np.ndarray:
    """Instants at which a friction sticks, (n_times,) of bool."""
    record = _rubbing(solution)
    assert record is not None
    return _stuck(record)[:, record.names.index(name)]


def undetermined_frictions(solution: RunResult) -> list[str]:
    """Warnings of joints held still by both their drive and friction, whose shares are indeterminate."""
    record, scene, found = _rubbing(solution), solution.model.scene, []
    for k, name in enumerate(() if record is None else record.names):
        assert record is not None
        drive, speed = scene.drives.get(name), abs(record.speed[:, k])
        still = speed <= _STILL * speed.max()
        before, after = np.r_[False, still[:-1]], np.r_[still[1:], False]
        still &= before | after  # no single instant of reversal
        friction = scene.frictions[name]
        if drive is None or drive.free or not still.any() or friction.law not in ("coulomb", "stribeck"):
            continue
        limit = ((friction.mu_static or friction.mu) * record.pressed[:, k] + friction.preload)[still].max()
        turns = scene.turns_at(name)
        found.append(
            f"friction at {name} is statically indeterminate at {still.sum()} of {len(still)} instants, first at t = "
            f"{solution.times[still.argmax()]:.6g} s, where its drive holds it still: any value between "
            f"-{limit:.4g} and {limit:.4g} {'N m' if turns else 'N'} is possible, and results contain one of them; "
            f"{'drive_torque' if turns else 'drive_force'} is uncertain by the same amount"
        )
    return found


def begun_anew(solution: RunResult) -> list[str]:
    """Warnings of bristles, and of closed contacts with an approach speed, that a continued run does not know."""
    scene, curve = solution.model.scene, getattr(solution.trajectory, "curve", None)
    if getattr(curve, "turned", None) is None or solution.model.options.start == "periodic":
        return []
    found = [f"bristles of law lugre at {name} begin undeflected, since the earlier run's deflection is not continued"
             for name, friction in scene.frictions.items() if friction.law == "lugre"]  # fmt: skip
    record = record_of(solution)
    for k, name in enumerate(() if record is None else record.names):
        assert record is not None
        if record.force[0, k] > 0.0 and scene.contacts[name].law not in ("hertz", "kelvin-voigt", "newton"):
            found.append(f"{name} is closed where the run begins: its law guesses the approach speed from the depth")
    return found


def labelled_frictions(solution: RunResult) -> tuple[dict[str, Entry], dict[str, Entry]]:
    """Coordinates and variables of frictions: ``friction_force`` etc. over time and ``friction``, for pins
    ``pin_torque`` etc. over ``pin``."""
    record = _rubbing(solution)
    coordinates: dict[str, Entry] = {}
    variables: dict[str, Entry] = {}
    for kind, push, units in (("friction", "force", ("N", "m/s")), ("pin", "torque", ("N m", "rad/s"))):
        turns, names = kind == "pin", () if record is None else record.names
        columns = [k for k, name in enumerate(names) if solution.model.scene.turns_at(name) == turns]
        if record is None or not columns:
            continue
        both, sticks = ("time", kind), _stuck(record)[:, columns].astype(np.int8)
        about = "joints and contacts with friction" if not turns else "pins with friction"
        coordinates[kind] = (kind, np.array(names)[columns], {"long_name": about})
        for key, values, unit, meaning in (
            (push, record.force, units[0], f"{push} of friction on the second side"),
            ("speed", record.speed, units[1], "speed of the second side past the first"),
            ("pressed", record.pressed, units[0],
             "normal force between the sides" + turns * ", times the radius of the pin"),
            ("lost", record.lost, "J", "energy lost by friction so far"),
            ("bristles", record.bristles, "rad" if turns else "m", "deflection of the bristles of law lugre"),
        ):  # fmt: skip
            variables[f"{kind}_{key}"] = (both, values[:, columns], {"units": unit, "long_name": meaning})
        variables[f"{kind}_sticks"] = (both, sticks, {"long_name": "1 if sticking"})
    return coordinates, variables


def labelled_contacts(solution: RunResult) -> tuple[dict[str, Entry], dict[str, Entry]]:
    """Coordinates and variables of contacts: ``contact_gap`` etc. over time and ``contact``, ``impact_begin`` etc.
    over ``impact``, of backlash over ``flank`` and ``flank_impact``; ``clearance_x`` etc. over time and
    ``clearance``."""
    record = record_of(solution)
    if record is None:
        return {}, {}
    turning = [name for name in record.names if solution.model.scene.contacts[name].kind == "angle"]
    coordinates: dict[str, Entry] = {}
    variables: dict[str, Entry] = {}
    for kind, names in (("contact", [name for name in record.names if name not in turning]), ("flank", turning)):
        if names:
            coordinates[kind] = (kind, np.array(names), {"long_name": f"{kind}s"})
            variables |= _of_kind(solution, record, names, kind)
    loose = solution.model.scene.loose
    if loose:
        coordinates["clearance"] = ("clearance", np.array(list(loose)), {"long_name": "joints with a clearance"})
        variables |= _in_clearances(solution)
    return coordinates, variables


def _of_kind(solution: RunResult, record: RowRecord, names: list[str], kind: str) -> dict[str, Entry]:
    """Variables of contacts of one kind, and of their impacts; for flanks in angles and torques."""
    turns, both = int(kind == "flank"), ("time", kind)
    columns = [record.names.index(name) for name in names]
    push = "torque" if turns else "force"
    variables: dict[str, Entry] = {
        f"{kind}_gap": (both, record.gap[:, columns], {
            "units": ("m", "rad")[turns], "long_name": f"gap between the sides of a {kind}",
            "comment": "negative by the penetration"
            + ("" if turns else "; for a circle in a circle the clearance less the eccentricity"),
        }),
        f"{kind}_{push}": (both, record.force[:, columns], {
            "units": ("N", "N m")[turns], "long_name": f"normal {push} of a {kind}",
        }),
        f"{kind}_lost": (both, record.lost[:, columns], {
            "units": "J", "long_name": f"energy lost by a {kind} so far",
        }),
    }  # fmt: skip
    impacts = [impact for impact in record.impacts if impact.contact in names]
    each = "flank_impact" if turns else "impact"
    if impacts:
        from kaneflex.multibody.unilateral.results import COLUMNS

        place = () if turns else "xy" if solution.model.in_space is None else "xyz"
        number = [names.index(impact.contact) for impact in impacts]
        about = {"long_name": f"number of its {kind}, from 0 on, among those of the coordinate {kind}"}
        variables[f"{each}_{kind}"] = (each, np.array(number, np.int32), about)
        for key in (*COLUMNS[:-3], *place):
            *units, meaning = _ABOUT[key]
            values = np.array([getattr(impact, key) for impact in impacts])
            variables[f"{each}_{key}"] = (each, values, {"units": units[turns], "long_name": meaning})
    return variables


def eccentricity(solution: RunResult, name: str) -> np.ndarray:
    """Eccentricity of a pin or block in its clearance, (n_times,): 0 in the middle, 1 at contact, more under
    penetration.

    For a block, that of the corner nearest to its face; for a pin in space of its end nearest to the bearing.
    """
    scene = solution.model.scene
    loose = scene.loose[name]
    keys = [key for key in loose.contacts if not loose.axis or scene.contacts[key].kind == "circle-in-circle"]
    gaps = np.array([solution.motion.contact(key)[0] for key in keys])
    return 1.0 - gaps.min(axis=0) / loose.room


def _in_clearances(solution: RunResult) -> dict[str, Entry]:
    """Positions of pins and blocks in their clearances."""
    both, names = ("time", "clearance"), list(solution.model.scene.loose)
    places = np.array([solution.motion.clearance(name) for name in names])
    about = {
        "clearance_x": ("m", "position of a pin in its bearing along x, global; for a block along its guide"),
        "clearance_y": ("m", "position of a pin in its bearing along y, global; for a block across its guide"),
        "clearance_angle": ("rad", "angle of a pin's body relative to its bearing's; tilt of a block in its guide"),
    }
    if solution.model.in_space is not None:
        from_first = "position of the second side from the first along"
        about = {f"clearance_{axis}": ("m", f"{from_first} {axis}, global") for axis in "xyz"}
    found: dict[str, Entry] = {
        key: (both, places[:, k].T, {"units": unit, "long_name": meaning})
        for k, (key, (unit, meaning)) in enumerate(about.items())
    }
    ratio = np.array([eccentricity(solution, name) for name in names]).T
    meaning = "eccentricity: 0 in the middle of a clearance, 1 where its sides touch"
    return found | {"eccentricity": (both, ratio, {"units": "1", "long_name": meaning})}


def _stuck(record: RowRecord) -> np.ndarray:
    """Instants at which each friction sticks, (n_times, n_frictions) of bool."""
    from kaneflex.multibody.model.layout import STICKING

    return record.mode == STICKING


def _rubbing(solution: RunResult) -> RowRecord | None:
    record = getattr(solution.trajectory, "frictions", None)
    return record if record is not None and record.names and len(record.force) else None


def record_of(solution: RunResult) -> RowRecord | None:
    """Record of a run's contacts; None without contacts, or if the run stopped at its start."""
    record = getattr(solution.trajectory, "contacts", None)
    return record if record is not None and record.names and len(record.gap) else None


# ---- contact lines ------------------------------------------------------------------------------------------------


def check_lines(model: Model) -> None:
    """Raise SceneError if a side touches the straight line of an elastic link far from the line's address at the start;
    the model needs no equations."""
    scene, first = model.scene, model.motion.at(0.0)
    for name, contact in _lines(model):
        line, point = contact.sides
        length = scene.bodies[line.body].length or 1.0
        start, end = (first.frame(side.body).place(scene.point(side)) for side in (line, point))
        (x, y), (n_x, n_y) = first.frame(line.body).to_body(end - start)[:, 0].tolist(), contact.direction
        along = (n_y * x - n_x * y) * n_y
        if abs(n_x * x + n_y * y - contact.reach) < _TOUCHING * length and abs(along) > _NEAR * length:
            raise SceneError(
                contact.entry(name), str(line),
                f"{line.body} is elastic, and its contact line is valid near this point only; {point.body} touches it "
                f"{1e3 * abs(along):.4g} mm away",
                f"Choose the point of {line.body} where it touches, or weld a rigid body there as the line",
            )  # fmt: skip


def off_their_lines(solution: RunResult) -> Iterator[str]:
    """Warnings of contacts that act where the axis of their elastic link leaves its straight line."""
    motion, scene = solution.motion, solution.model.scene
    for name, contact in _lines(solution.model):
        line, point = contact.sides
        pushed = np.flatnonzero(motion.contact(name)[1] > 0.0)
        if not len(pushed):
            continue
        taken = motion.scalars.taken(pushed)
        frame, _ = taken.section_frame(BodyPoint(line.body, line.point, scene.point(line)))
        touched = taken.moving_place(point.body, scene.point(point))[0][:2]
        (x, y), (n_x, n_y) = frame.to_body(touched - frame.origin), contact.direction
        along, places = n_y * x - n_x * y, solution.model.links[line.body].nodes
        nodes = (taken.moving_place(line.body, (float(x), 0.0))[0][:2] - frame.origin for x in places)
        above = np.array([n_x * u + n_y * v for u, v in map(frame.to_body, nodes)])
        foot = scene.point(line)[0] + contact.direction[1] * along
        off = np.array([np.interp(x, places, each) for x, each in zip(foot, above.T, strict=True)])
        off *= abs(contact.direction[1])  # a line across a section is exact, since sections stay plane
        bent = abs(motion.nodes(line.body)[1::3]).max()
        k = int(abs(off).argmax())
        if abs(off[k]) > _SHARE * bent:
            yield (
                f"the line of {contact.table_key(name)} is the tangent of {line.body} at {line}; at t = "
                f"{taken.times[k]:.6g} s {point.body} touches it {1e3 * abs(along[k]):.4g} mm from there, where the "
                f"bent axis is {1e3 * abs(off[k]):.3g} mm off this tangent (largest deflection "
                f"{1e3 * bent:.3g} mm); choose the point where it touches, or weld a rigid body there as the line"
            )


def _lines(model: Model) -> Iterator[tuple[str, Contact]]:
    """Contacts whose line is on an elastic link."""
    for name, contact in model.scene.contacts.items():
        body = model.scene.bodies.get(contact.sides[0].body)
        if contact.kind == "point-line" and body is not None and body.elastic:
            yield name, contact
