"""Warnings about implausible values in a scene."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

import numpy as np

from kaneflex.scene.beams import Damping, Sectioned
from kaneflex.scene.bodies import Body
from kaneflex.scene.drives import Drive
from kaneflex.scene.parts import Joint, Load, Mass
from kaneflex.scene.quantities import Address
from kaneflex.scene.scene import Scene, given_value
from kaneflex.scene.sections import Constants
from kaneflex.scene.sensors import SECTION_KINDS, Sensor
from kaneflex.scene.tables import Table, largest_of_block, overshoot_of_block
from kaneflex.support.units import ANGLE

_LONG = 10.0
"""Length [m] of a link beyond which a plain number is suspected to be in millimetres."""
_APART = 1e3
"""Largest ratio of the lengths of two bodies without a warning."""
_MODULI, _DENSITIES = (1e5, 1.3e12), (0.1, 2.3e4)
"""Plausible ranges: Young's moduli [Pa] from silicone gel to diamond, densities [kg/m^3] from aerogel to osmium."""
_SOUND = (8.0, 2e4)
"""Plausible speeds of sound sqrt(E / rho) in a thin bar [m/s], from gel to beyond diamond's 18 km/s."""
_FASTEST = 2e3
"""Largest rim speed [m/s] that a material withstands: sqrt(strength / density), 1.8 km/s for the strongest carbon
fibres."""
_GRAVITIES = (0.05, 300.0)
"""Plausible acceleration of gravity [m/s^2], from an asteroid's to the sun's."""
_FAR = 30.0
"""Largest radius of gyration of a rigid body without a warning, as a multiple of the mechanism's size."""
_STUBBY, _STUBBIEST = 10.0, 3.0
"""Slenderness (length over radius of gyration) below which shear adds a tenth or more to the bending of a cantilever,
and below which beam theories do not apply."""
_STOUT = 10.0
"""Largest width of a section (from area and second moments) without a warning, as a multiple of the length."""
_HOLLOW = 1e4
"""Largest second moment over area squared without a warning: r / (4 pi t) of a tube with t / r = 8e-6."""
_ROUNDED = 1e-3
"""Relative error of sums of rounded numbers without a warning."""
_STOPPED = 0.01
"""Speed with which a drive's table begins or ends without a warning, as a share of its largest."""
_BEYOND_ROWS = 0.02
"""Overshoot of a table's curve between two rows without a warning, as a share of its largest value."""


def implausible(scene: Scene) -> tuple[str, ...]:
    """Warnings from the scene alone: numbers in a wrong unit, and overshoot of tables' curves."""
    bodies = scene.bodies
    long = [*_long_links(bodies, scene.raw)]
    apart = () if long else _far_apart(bodies)
    found = (apart, _materials(bodies), _sections(bodies), _speeds(scene), _inertias(bodies, scene.ground),
             _massless(bodies, scene.joints, scene.masses), _damping(scene.damping), _cuts(scene), _fibres(scene),
             _plain_numbers(scene))  # fmt: skip
    return (*long, *(text for each in found for text in each), *_tables(scene))


def _plain_numbers(scene: Scene) -> Iterator[str]:
    """Warnings of angles of more than a turn by plain numbers, which are in rad, and of gravity on no planet."""
    for path in (*(["drives", name, "angle"] for name in scene.drives), ["solve", "mode_angle"]):
        given = given_value(scene.raw, path)
        if isinstance(given, int | float) and abs(given) > math.tau:
            yield f"{'.'.join(path)} = {given:g} is in rad: write '{given:g} deg' with its unit where degrees are meant"
    g = math.hypot(*scene.gravity)
    if g and not _GRAVITIES[0] <= g <= _GRAVITIES[1]:
        yield f"gravity is {g:.4g} m/s^2, where the earth's is 9.81: a plain number is in m/s^2"


def _sections_read(scene: Scene) -> Iterator[tuple[str, Sensor, Address, Body, float]]:
    """Name, sensor, address, body and distance from its start [m] of every sensor in a section of a beam."""
    for name, sensor in scene.sensors.items():
        if sensor.kind in SECTION_KINDS and isinstance(address := sensor.target, Address):
            if (body := scene.bodies[address.body]).beam is not None:
                yield name, sensor, address, body, scene.point(address)[0]


def _cuts(scene: Scene) -> Iterator[str]:
    """Warnings of sensors without ``cut`` where section forces, or for a strain the section, jump."""
    for name, sensor, address, body, x in _sections_read(scene):
        if "cut" in sensor.model_fields_set:
            continue
        changes = sensor.kind == "strain" and x in {piece.stop for piece in body.profile.pieces[:-1]}
        if x in scene.acted_on(address.body) or changes:
            why = "the section changes" if changes else "a force acts"
            yield f'{name} is measured just before {address}, where {why}: give cut = "before" or "after"'


def _fibres(scene: Scene) -> Iterator[str]:
    """Warnings of strain gauges outside a section of known shape: beyond half its height, in space or width."""
    for name, sensor, address, body, x in _sections_read(scene):
        piece = body.profile.piece_at(x, sensor.cut == "after")
        if sensor.fibre is None or piece.shape is None:
            continue
        height, second = (*piece.dimensions(x), 0.0)[:2]
        sides = (height, second if piece.shape.kind in ("rectangle", "I") else height)
        fibre = sensor.fibre if isinstance(sensor.fibre, tuple) else (sensor.fibre,)
        for at, side, of in zip(fibre, sides, ("high", "wide"), strict=False):
            if abs(at) > 0.5 * (1.0 + _ROUNDED) * side:
                yield (
                    f"sensors.{name}.fibre: {at:.4g} m from the axis is outside of the section at {address}, which is "
                    f"{side:.4g} m {of}"
                )


def stubby_links(bodies: Mapping[str, Body], in_space: bool) -> Iterator[str]:
    """Warnings of elastic links that are too short for their beam theory.

    Shear adds 3 E I / (kappa G A length^2) to the deflection of a cantilever's tip (Timoshenko 1921), which is 9.36
    over the slenderness squared for nu = 0.3 and kappa = 5/6.
    """
    for name, body in bodies.items():
        if body.beam is None or body.length is None:
            continue
        middle = body.profile.at(body.length / 2)
        radius = math.sqrt(max(middle.E_I_z, middle.E_I_y * in_space) / middle.E_A)  # in space the larger one
        slenderness = body.length / radius
        if slenderness >= (_STUBBIEST if body.beam.shear else _STUBBY):
            continue
        slender = f"bodies.{name}.length is only {slenderness:.2g} radii of gyration of its section"
        if slenderness < _STUBBIEST:
            yield f"{slender}, too short for any beam theory: leave its beam out, or use modal_data of finite elements"
        else:
            share = 9.36 / slenderness**2
            yield f"{slender}: shear would add some {share:.0%} to its bending; give theory = 'timoshenko' and nu"


def _far_apart(bodies: Mapping[str, Body]) -> Iterator[str]:
    """Warning if the lengths of two bodies differ as much as units do."""
    lengths = {name: body.length for name, body in bodies.items() if body.length}
    if not lengths:
        return
    shortest, longest = min(lengths, key=lengths.__getitem__), max(lengths, key=lengths.__getitem__)
    if (times := lengths[longest] / lengths[shortest]) > _APART:
        yield (
            f"bodies.{longest}.length is {times:.4g} times bodies.{shortest}.length, {lengths[longest]:.4g} m and "
            f"{lengths[shortest]:.4g} m: check the units of both"
        )


def _damping(damping: Damping | None) -> Iterator[str]:
    """Warning if links are damped so much that they don't vibrate."""
    if damping is None or damping.viscous is not None:
        return
    given = damping.rayleigh.ratio if damping.rayleigh is not None else damping.modal and damping.modal.ratio
    ratio = max(given, default=0.0) if isinstance(given, tuple) else 0.0 if isinstance(given, str) else given or 0.0
    if ratio >= 1.0:
        yield (
            f"damping.{damping.kind}.ratio = {ratio:g} is {ratio:.0%} of the critical damping: nothing vibrates; "
            "write per cent with the sign, like '2 %'"
        )


def _sectioned(bodies: Mapping[str, Body]) -> Iterator[tuple[str, Body, Sectioned, Constants]]:
    """Key, body, section and material of every section of a beam."""
    for name, body in bodies.items():
        if (beam := body.beam) is not None:
            yield from ((f"bodies.{name}.{key}", body, part, beam.made_of(part)) for key, part in beam.sections.items())


def _materials(bodies: Mapping[str, Body]) -> Iterator[str]:
    """Warnings of moduli and densities outside the range of materials."""
    for where, _, _, made_of in _sectioned(bodies):
        E, rho = made_of.E, made_of.rho
        if E is None or rho is None:
            continue
        numbers = ("E", E, "Pa", _MODULI, "210 GPa"), ("rho", rho, "kg/m^3", _DENSITIES, "7850 kg/m^3")
        strange = [each for each in numbers if not each[3][0] <= each[1] <= each[3][1]]
        for field, value, unit, (low, high), steel in strange:
            reason = f"outside the range of materials, {low:g} to {high:g}: steel has '{steel}'"
            yield f"{where}.{field} = {value:.4g} {unit} is {reason}"
        if not strange and not _SOUND[0] <= (sound := math.sqrt(E / rho)) <= _SOUND[1]:
            yield (
                f"{where}: E = {E:.4g} Pa and rho = {rho:.4g} kg/m^3 give a speed of sound of {sound:.3g} m/s, "
                "outside the range of materials; steel has '210 GPa' and '7850 kg/m^3'"
            )


def _sections(bodies: Mapping[str, Body]) -> Iterator[str]:
    """Warnings of torsion constants above the polar moment, which is their upper bound (Saint-Venant); of sections much
    wider than their link's length, or with an area much too small for their second moment, as for an I in mm^4 without
    its unit."""
    for where, body, part, made_of in _sectioned(bodies):
        polar = (part.I_y or 0.0) + (part.I_z or 0.0)
        if part.J is not None and part.J > (1.0 + _ROUNDED) * polar:
            bound = f"I_y + I_z = {polar:.4g} m^4, the upper bound of a torsion constant"
            yield f"{where}.J = {part.J:.4g} m^4 is more than {bound}"
        if body.length is None:
            continue
        area = part.A or body.mass / ((made_of.rho or math.inf) * body.length)
        for field, root, unit in (("A", 2, "m^2"), ("I", 4, "m^4"), ("I_y", 4, "m^4"), ("I_z", 4, "m^4")):
            given = getattr(part, field) or 0.0
            reason = f"but the link is only {body.length:.4g} m long: a plain number is in {unit}"
            if (wide := given ** (1.0 / root)) > _STOUT * body.length:
                yield f"{where}.{field} = {given:.4g} {unit} means a section {wide:.3g} m wide, {reason}"
            elif root == 4 and given > min(_HOLLOW * (part.A or math.inf) ** 2, area * body.length**2):
                yield (
                    f"{where}.{field} = {given:.4g} {unit} with A = {area:.4g} m^2 means a radius of gyration of "
                    f"{math.sqrt(given / area):.3g} m, {reason}, and '1 mm^4' is 1e-12 m^4"
                )


def _speeds(scene: Scene) -> Iterator[str]:
    """Warnings of drives at a speed that no rotating material withstands or that no guide reaches."""
    for name, drive in scene.drives.items():
        if not drive.speed:
            continue
        slides = scene.slides(name)
        speed, of, unit = abs(drive.speed), "it", "m/s"
        why = f"guides of machines stay far below {_FASTEST:g} m/s"
        if not slides:
            why, unit = f"centrifugal forces break any material beyond about {_FASTEST:g} m/s", "rad/s"
            moved = [side.body for side in scene.joints[name].addresses if side.body in scene.bodies]
            of, reach = max(((body, _reach(scene.bodies[body])) for body in moved), key=lambda each: each[1])
            speed *= reach
        if speed > _FASTEST:
            yield (
                f"drives.{name}.speed = {scene.written_speed(name, drive.speed)} moves {of} at {speed:.4g} m/s: "
                f"{why}; a plain number is in {unit}"
            )


def _reach(body: Body) -> float:
    """Distance of a body's furthest point from its start [m]."""
    return max(math.hypot(*place) for place in body.points_all.values())


def _inertias(bodies: Mapping[str, Body], ground: Mapping[str, tuple[float, ...]]) -> Iterator[str]:
    """Warnings of rigid bodies with a radius of gyration far beyond the mechanism, as for inertia in kg mm^2."""
    reach = max(map(_reach, bodies.values()), default=0.0)
    size = max([reach, *(math.hypot(*place) for place in ground.values())])
    for name, body in bodies.items():
        inertia = max(body.inertia) if isinstance(body.inertia, tuple) else body.inertia
        radius = math.sqrt(inertia / body.mass) if body.mass else 0.0
        if size and radius > _FAR * size:
            yield (
                f"bodies.{name}.inertia = {inertia:.4g} kg m^2 of {body.mass:.4g} kg means a radius of gyration of "
                f"{radius:.4g} m, but the mechanism is only {size:.4g} m large: a plain number is in kg m^2"
            )


def _massless(
    bodies: Mapping[str, Body], joints: Mapping[str, Joint], masses: Mapping[str, Mass]
) -> Iterator[str]:
    """Warnings of rigid bodies on a guide (like pistons) without mass and inertia."""
    carrying = {mass.at.body for mass in masses.values()}
    guides = [joint for joint in joints.values() if joint.kind in ("prismatic", "cylindrical")]
    guided = dict.fromkeys(address.body for joint in guides for address in joint.addresses if address.body != "ground")
    for name in guided:
        body = bodies[name]
        if not (body.mass or name in carrying or body.modal is not None or "inertia" in body.model_fields_set):
            yield f"bodies.{name} has no mass: it adds no inertia force and no weight; give its mass if it has one"


def _long_links(bodies: Mapping[str, Body], raw: Mapping[str, Any]) -> Iterator[str]:
    """Warnings of links longer than 10 m with a length without unit: plain numbers are in SI."""
    for name, body in bodies.items():
        given = given_value(raw, ("bodies", name, "length"))
        if isinstance(given, int | float) and body.length is not None and body.length > _LONG:
            cure = f"write '{given:g} mm' or '{given:g} m'"
            yield f"bodies.{name}.length = {given:g} is {given:g} m, since a plain number is in SI: {cure}"


def _stops(key: str, table: Table, curve: np.ndarray, unit: str, horizon: float) -> Iterator[str]:
    """Warnings of the speed at the ends of a drive's table inside a run of ``horizon`` [s], where the joint stops."""
    x, (_, *first), (_, *last) = table.x, *curve[len(table.x) + 4 :].reshape(-1, 4)[[1, -2]]
    final = last @ (np.array([1.0, 2.0, 3.0]) * (x[-1] - x[-2]) ** np.arange(3))
    for word, t, speed, inside in (("begins", x[0], first[0], x[0] > 0.0), ("ends", x[-1], final, x[-1] < horizon)):
        if inside and abs(speed) > _STOPPED * abs(np.diff(table.y) / np.diff(x)).max():
            yield (
                f"{key}: its table {word} at {t:.4g} s with {speed:.4g} {unit}, and the joint stands still outside, so "
                "that its speed jumps there; add rows that bring it to rest"
            )


def _tables(scene: Scene) -> Iterator[str]:
    """Warnings of tables that were closed automatically, whose smooth curve overshoots between two rows, or that stop a
    joint with a jump."""
    tables: dict[str, tuple[Load | Drive, str]]
    tables = {f"loads.{name}": (load, load.si_unit) for name, load in scene.loads.items() if load.kind == "table"}
    for name, drive in scene.drives.items():
        if drive.kind == "table":
            tables[f"drives.{name}"] = (drive, "m" if scene.slides(name) else "rad")
    for key, (reader, unit) in tables.items():
        curve, table = reader.curve(), reader.read_table()
        angles = table.x_dimension is ANGLE
        if table.closed:
            factor, x_unit = (180 / math.pi, "deg") if angles else (1.0, table.x_dimension.unit)
            end, back = (f"{factor * x:.6g} {x_unit}" for x in table.x[-2:])
            name = Path(reader.table or "").name
            yield f"{key}: {name} ends at {end}, before its period: its first row is repeated at {back}"
        if key.startswith("drives.") and not reader.period:
            yield from _stops(key, table, curve, f"{unit}/s", scene.horizon or 0.0)
        beyond = overshoot_of_block(curve)
        if beyond.size > _BEYOND_ROWS * largest_of_block(curve):
            x, x_unit = (np.degrees(beyond.x), "deg") if angles else (beyond.x, table.x_dimension.unit)
            first, last = beyond.rows
            yield (
                f"{key}: its {reader.interpolation} reaches {beyond.value:.4g} {unit} at {x:.4g} {x_unit}, between "
                f"rows of {first:.4g} and {last:.4g} {unit}; give more rows, or interpolation = 'pchip', which does "
                "not overshoot"
            )
