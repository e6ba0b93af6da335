"""What the command line prints: SI comes in, millimetres, kilonewtons and degrees go out."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from typing import TYPE_CHECKING

import click
import numpy as np

from kaneflex.report.contacts import contact_line, friction_line
from kaneflex.scene.options import has_term
from kaneflex.scene.parts import TERM_NAMES
from kaneflex.solve.initial import start_coordinates

if TYPE_CHECKING:
    from kaneflex.fem.mobility import Freedom
    from kaneflex.multibody.model import Model
    from kaneflex.report.summary import Instant, SensorSummary, Summary
    from kaneflex.scene import Scene
    from kaneflex.scene.bodies import Body
    from kaneflex.scene.events import Event
    from kaneflex.scene.parts import Joint, Load
    from kaneflex.scene.springs import Spring
    from kaneflex.solve.statespace import StateSpace

PRESETS_IN_WORDS = {
    "rigid": "kinematics, inverse dynamics and joint reactions; nothing deforms",
    "quasistatic": "(K_s + K_d + K_g) z = F at each instant, without damping",
    "paper": "the paper's choices: one element a link, welded pin, frozen decoupled modes, from rest, 0.04 s",
    "linear": "time-varying M, C, K of the released joints, without K_g",
    "stiffened": "linear, with K_g from the joint reactions and foreshortening in the displacements",
    "coupled": "motion and deformation together, nonlinear; shapes of each link, error-controlled steps",
}
_MOST_POLES = 8
_FOR_PEOPLE = {  # SI unit: (unit shown, factor)
    "m": ("mm", 1e3),
    "N": ("kN", 1e-3),
    "rad": ("deg", 180.0 / math.pi),
    "rad/s": ("deg/s", 180.0 / math.pi),
    "rad/s^2": ("deg/s^2", 180.0 / math.pi),
}
_WHEN_SMALL = {"m": (1e-6, "um", 1e6), "N": (10.0, "N", 1.0)}
"""SI unit: values below this are shown in that unit, which is so many times finer."""


def table(head: Sequence[str], rows: Sequence[Sequence[str]], left: int = 1) -> str:
    """Rows of text in aligned columns, the first ``left`` of them to the left, under a bold head."""
    widths = [max(map(len, column)) for column in zip(head, *rows, strict=True)]

    def line(cells: Sequence[str]) -> str:
        placed = [
            cell.ljust(width) if k < left else cell.rjust(width)
            for k, (cell, width) in enumerate(zip(cells, widths, strict=True))
        ]
        return "  ".join(placed).rstrip()

    return "\n".join([click.style(line(head), bold=True), *map(line, rows)])


def summary_table(summary: Summary) -> str:
    """The sensors of a run with their extremes, and where they are."""
    when = "s" if any(entry.at_min.drive_deg is None for entry in summary.sensors.values()) else "deg"
    head = ("sensor", "unit", "min", f"at {when}", "max", f"at {when}", "mean", "rms")
    return table(head, [_sensor_row(name, entry) for name, entry in summary.sensors.items()], left=2)


def unit_shown(unit: str, largest: float) -> tuple[str, Callable[[float], str]]:
    """The unit for people of values up to ``largest`` (SI), and what writes an SI value in it."""
    shown, factor = _FOR_PEOPLE.get(unit, (unit, 1.0))
    if unit in _WHEN_SMALL and 0.0 < largest < _WHEN_SMALL[unit][0]:
        _, shown, factor = _WHEN_SMALL[unit]

    def number(value: float) -> str:
        return f"{value * factor:.4g}" if abs(value * factor) < 1e4 else f"{value * factor:.0f}"

    return shown, number


def _sensor_row(name: str, entry: SensorSummary) -> tuple[str, ...]:
    unit, number = unit_shown(entry.unit, max(abs(entry.min), abs(entry.max)))

    def where(instant: Instant) -> str:
        return f"{instant.time_s:.5g}" if instant.drive_deg is None else f"{instant.drive_deg:.1f}"

    lowest, highest = where(entry.at_min), where(entry.at_max)
    return (name, unit, number(entry.min), lowest, number(entry.max), highest, number(entry.mean), number(entry.rms))


def envelope_table(summary: Summary) -> str:
    """How the peaks of a frozen model depend on the angle at which it is frozen."""
    rows = []
    for name, spread in summary.mode_angle_spread.items():
        unit, number = unit_shown(summary.sensors[name].unit, spread.largest)
        rows.append((name, unit, number(spread.smallest), number(spread.largest)))
    return table(("frozen at any angle of a turn", "unit", "smallest peak", "largest peak"), rows, left=2)


def contact_table(summary: Summary) -> str:
    """What every contact did; where it says nothing of a rest it is open at the end."""
    rows = []
    for name, contact in summary.contacts.items():
        fastest, force = f"{contact.fastest_m_s or 0.0:.4g}", f"{contact.largest_force or 0.0:.5g}"
        if contact.largest_torque is not None:
            fastest, force = f"{contact.fastest_rad_s or 0.0:.4g} rad/s", f"{contact.largest_torque:.5g} N m"
        rest = "" if contact.rests_since_s is None else f"{contact.rests_since_s:.5g}"
        rows.append((name, f"{contact.impacts}", fastest, force, f"{contact.lost:.4g}", rest))
    return table(("contact", "impacts", "fastest m/s", "largest N", "lost J", "rests from s"), rows)


def friction_table(summary: Summary) -> str:
    """What every friction did."""
    rows = []
    for name, friction in summary.frictions.items():
        turns = friction.largest_torque is not None
        largest = f"{friction.largest_torque:.5g} N m" if turns else f"{friction.largest_force:.5g} N"
        rows.append((name, largest, f"{friction.lost:.4g}", f"{100 * friction.stuck:.3g}"))
    return table(("friction", "largest", "lost J", "stuck %"), rows)


def run_lines(summary: Summary) -> str:
    """What was run and what it took, in two lines."""
    timing = summary.timing
    parts = [f"{timing.set_up_s + timing.compile_s:.2f} s to set up", f"{timing.integrate_s:.2f} s to solve"]
    if timing.derive_s:
        parts.insert(0, f"{timing.derive_s:.2f} s to derive")
    if timing.ns_per_step:
        parts.append(f"{timing.ns_per_step:.0f} ns a step")
    steps = f"{summary.steps} steps over {summary.duration_s:.6g} s"
    if summary.outcome != "completed":
        steps = f"{summary.steps} steps asked for, {_reached(summary)}"
    return (
        f"{summary.scene}, preset {summary.preset}: {summary.degrees_of_freedom} degrees of freedom, "
        f"{summary.modes_kept} coordinates solved for, {steps}\n"
        f"{', '.join(parts)}"
    )


def _reached(summary: Summary) -> str:
    return f"results over {summary.duration_s:.6g} s" if summary.stored else "none of them taken"


def description(model: Model) -> str:
    """What a scene is, for ``kaneflex check``: one line for each part of the mechanism."""
    scene = model.scene
    blocks = [
        parts(scene),
        block("assumptions", scene.assumptions),
        block("over the run" if _followed(model) else "at the start", _reach(model)),
        block("options in force", _options(model)),
        block(
            "equations",
            {
                "degrees of freedom": str(model.degrees_of_freedom),
                "coordinates": " ".join((*model.coordinates, *model.shapes_given)) or "none",
                **({} if model.coupled is None else {"coordinates of a state": " ".join(start_coordinates(model))}),
                "structure": model.motion.module.STRUCTURE,
                "module": _module(model),
            },
        ),
    ]
    return "\n".join(filter(None, blocks))


def _followed(model: Model) -> bool:
    """Whether the rigid motion is that of the run: not under preset coupled where joints are free."""
    return bool(model.scene.drives) and not (model.coupled is not None and model.module.FREE)


def _reach(model: Model) -> dict[str, str]:
    """Where the joints go in the rigid mechanism."""
    from kaneflex.mechanism.reach import courses_of, reach_lines

    if model.scene.is_frame:
        return {}
    times = np.linspace(0.0, model.options.duration, 721) if _followed(model) else np.zeros(1)
    return reach_lines(model.scene, courses_of(model.scene, model.motion.at(times)))


def _options(model: Model) -> dict[str, str]:
    """Every option of a run in words, with its unit; those that its preset has no use for are left out."""
    options, dynamics = model.options, model.options.dynamics
    per = "in a cycle" if options.cycles else "in the run"
    shown = {
        "preset": f"{options.preset}: {PRESETS_IN_WORDS[options.preset]}",
        "duration": f"{_time(options.duration)}{', one cycle' if options.cycles else ''}",
        "steps": f"{options.steps} {per}, {_time(model.step)} each",
    }
    if model.module.FREE and dynamics != "coupled":
        shown["forward"] = f"{options.forward_method} for free joints, tolerance {options.forward_tolerance:g}"
    if dynamics == "rigid":
        return shown
    if dynamics == "coupled":
        error = f"error in ten periods of a vibration {options.tolerance:g} of the longest body"
        bounded = f", of {' and '.join(options.bounded)} as much of their largest" if options.bounded else ""
        shown["integrator"] = f"{options.integrator}, {error}{bounded}"
        shown["start"] = _STARTS[options.start]
        if not model.links:
            modal = any(body.modal is not None for body in model.scene.bodies.values())
            shown["shapes"] = "those of the modal data" if modal else "none: all bodies are rigid"
            return shown
        shown["shapes"] = f"static ones and {options.modes} modes of each link"
        shown["elements"] = ", ".join(f"{name} {len(link.nodes) - 1}" for name, link in model.links.items())
        return shown
    if dynamics in ("dynamic", "frozen"):
        own = f", spectral radius {options.rho_infinity:g} at infinite frequency"
        shown["integrator"] = options.integrator + (own if options.integrator == "generalised-alpha" else "")
        shown["start"] = _STARTS[options.start]
    terms = [name for name in TERM_NAMES if getattr(options, name) and has_term(model.scene, name)]
    shown["terms"] = ", ".join([*terms, *(["turning of the joint axes"] if options.convective else [])]) or "none"
    shown["elements"] = ", ".join(f"{name} {len(link.nodes) - 1}" for name, link in model.links.items())
    shown["pins"] = "rotation shared by elastic links" if options.weld_pins else "rotation released, but where shared"
    shown["drives"] = "elastic rotation free" if options.free_drives else "elastic rotation held, but where free"
    shown["foreshortening"] = "in the displacements" if options.foreshortening else "left out"
    kept = "all" if options.modes == "all" else str(options.modes)
    of = {"craig-bampton": f", {kept} modes of each link", "modal": f", {kept} modes of the mechanism", "none": ""}
    shown["reduction"] = options.reduction + of[options.reduction]
    shown["mode angle"] = at_drive(model) or "none: nothing is driven"
    return shown


_STARTS = {
    "zero": "from rest, undeformed", "quasistatic": "from the quasi-static answer", "periodic": "periodic",
    "given": "from the state that the scene gives",
}  # fmt: skip


def _time(seconds: float) -> str:
    for unit, factor in (("s", 1.0), ("ms", 1e3)):
        if seconds * factor >= 1.0:
            return f"{seconds * factor:.6g} {unit}"
    return f"{1e6 * seconds:.6g} us"


def at_drive(model: Model) -> str:
    """The configuration of the reference modes, "main = 90 deg", by every drive; empty without one."""
    stands = model.reference_coordinates.items()
    return ", ".join(f"{drive} = {model.scene.written_coordinate(drive, value)}" for drive, value in stands)


def parts(scene: Scene) -> str:
    """What a mechanism is made of, moved and loaded by, and what is measured."""
    from kaneflex.response.sensors import describe

    closing = scene.loop_joints()
    blocks = [
        f"{scene.name}: {scene.description}",
        block("bodies", {name: _body(body) for name, body in scene.bodies.items()}),
        block("joints", {name: _joint(joint, name in closing) for name, joint in scene.joints.items()}),
        block("masses", {name: f"{mass.mass:.6g} kg at {mass.at}" for name, mass in scene.masses.items()}),
        block("drives", {name: _drive(scene, name) for name in scene.drives}),
        block("loads", {name: _load(load) for name, load in scene.loads.items()}),
        block("springs", {name: _spring(spring) for name, spring in scene.springs.items()}),
        block("contacts", {name: contact_line(contact) for name, contact in scene.contacts.items()}),
        block("friction", {name: friction_line(friction) for name, friction in scene.frictions.items()}),
        block("sensors", {name: describe(sensor) for name, sensor in scene.sensors.items()}),
        block("events", {name: _event(scene, event) for name, event in scene.events.items()}),
    ]
    return "\n".join(filter(None, blocks))


def mobility_lines(count: Freedom, elastic: int | None) -> str:
    """The count of the degrees of freedom; ``elastic`` is None where that part is not known."""
    taken = ", ".join(f"{name} {number}" for name, number in count.constraints.items())
    rows = {
        "bodies": (3 * count.bodies, f"{count.bodies} of 3 each"),
        "joints": (-sum(count.constraints.values()), taken),
        "drives": (-len(count.prescribed), ", ".join(count.prescribed)),
        "free joints": (-len(count.free), ", ".join(count.free)),
        "free bodies": (-3 * len(count.floating), ", ".join(count.floating)),
        "left": (count.left, count.verdict),
    }
    for what, names in (("free joints", count.free), ("free bodies", count.floating)):
        if not names:
            del rows[what]
    if elastic is not None:
        rows["elastic"] = (elastic, "displacements and rotations of the links, before any reduction to modes")
    return block("degrees of freedom", {name: f"{number:4d}  {text}".rstrip() for name, (number, text) in rows.items()})


def block(title: str, entries: Mapping[str, str]) -> str:
    """Names and what is said of them, indented under a bold title; nothing where there are none."""
    if not entries:
        return ""
    width = max(map(len, entries))
    lines = [f"  {name:<{width}}  {text}" for name, text in entries.items()]
    return "\n".join([click.style(title, bold=True), *lines])


def _module(model: Model) -> str:
    name = model.module.__name__
    return name if name.startswith("kaneflex.generated.") else f"{model.module.__file__}, derived from this structure"


def _body(body: Body) -> str:
    kind = f"elastic, {body.beam.elements} elements" if body.elastic else "rigid"
    kind = kind if body.modal is None else "elastic by modal data"
    length = "" if body.length is None else f", {1e3 * body.length:.6g} mm"
    return f"{kind}{length}, {body.mass:.6g} kg"


def _joint(joint: Joint, closes: bool) -> str:
    closing = f", closes a loop, branch {joint.branch}" if closes else ""
    return f"{joint.kind}, {joint.addresses[0]} to {joint.addresses[1]}{closing}"


def _load(load: Load) -> str:
    if load.spread_on is not None:
        return f"{load.kind} spread along {load.spread_on}, from {load.profile[0]:g} to {load.profile[1]:g} of its size"
    return f"{load.kind} on {load.force_on}" if load.force_on is not None else f"{load.kind} at {load.torque_at}"


def _spring(spring: Spring) -> str:
    per, where = ("N m{}/rad", f"at {spring.torsional_at}")
    if spring.ends:
        per, where = ("N{}/m", f"{spring.ends[0]} to {spring.ends[1]}, free length {1e3 * spring.length:.6g} mm")
    return f"{spring.stiffness:.6g} {per.format('')}, {spring.damping:.6g} {per.format(' s')}, {where}"


def _event(scene: Scene, event: Event) -> str:
    ways = {"up": "upwards", "down": "downwards", "both": "either way"}[event.direction]
    unit = scene.sensors[event.sensor].unit
    ending = ", which ends the run" if event.stop else ""
    return f"{event.sensor} passes {scene.level(event):.6g} {unit} {ways}{ending}"


def _drive(scene: Scene, name: str) -> str:
    drive = scene.drives[name]
    start = scene.written_coordinate(name, drive.start)
    cycle = "" if drive.cycle is None else f", a cycle of {math.degrees(drive.cycle):.6g} deg"
    if drive.kind in ("law", "table"):
        return f"{drive.kind} in t" if drive.kind == "law" else "table against t"
    if drive.kind == "free":
        return f"free, from {start} at {scene.written_speed(name, drive.initial_speed)}"
    if drive.kind == "spin up":
        cycle = f", reached in {drive.spin_up:.6g} s"
    return f"{scene.written_speed(name, drive.speed)} from {start}{cycle}"


def modes_table(model: Model, names: Sequence[str], hertz: np.ndarray, shapes: np.ndarray) -> str:
    """Frequencies, and the coordinates that are displaced [m] and that turn [rad] most in each mode."""
    names, moved = (list(names), shapes) if model.coupled is not None else _nodal(model, shapes)
    last = {name: name.rpartition(".")[2] for name in names}
    turning = {name for name, what in last.items() if what in ("theta", "turn", "phi")}
    shifting = {name for name, what in last.items() if name not in turning and not what.startswith("mode_")}

    def largest(shape: np.ndarray, among: set[str]) -> str:
        sizes = {name: abs(x) for name, x in zip(names, shape, strict=True) if name in among}
        most = max(sizes.values(), default=0.0)
        # of what moves alike, the two ends of a beam, the first: rounding must not choose
        return next((name for name, size in sizes.items() if size >= (1 - 1e-6) * most), "none")

    rows = [
        (str(k + 1), f"{value:.3f}", largest(moved[:, k], shifting), largest(moved[:, k], turning))
        for k, value in enumerate(hertz)
    ]
    head = ("mode", "Hz", "largest displacement", "largest rotation")
    where = at_drive(model)
    return "\n".join([*([f"{model.scene.name} at {where}"] if where else []), table(head, rows, left=0)])


def _nodal(model: Model, shapes: np.ndarray) -> tuple[list[str], np.ndarray]:
    """Mode shapes by coordinate, with the nodes of each reduced link below: q = basis L z."""
    names, rows = list(model.coordinates), [*shapes]
    rigid = model.motion.at(model.reference_time)
    for link, basis in model.bases.items():
        own = [basis @ rigid.apply(model.frame.maps[link], shape[:, None])[:, 0] for shape in shapes.T]
        names += model.links[link].part.coordinates
        rows += zip(*own, strict=True)
    return names, np.array(rows)


def poles_table(system: StateSpace) -> str:
    """The slowest poles of a state space: frequency and damping ratio."""
    poles = system.poles[:_MOST_POLES]
    damping = [round(-pole.real / abs(pole), 8) + 0.0 for pole in poles]  # without the sign of a rounded zero
    rows = [
        (str(k + 1), f"{abs(pole) / (2 * math.pi):.3f}", f"{ratio:.3%}")
        for k, (pole, ratio) in enumerate(zip(poles, damping, strict=True))
    ]
    return table(("pole", "Hz", "damping"), rows, left=0)


def sensitivity_table(summary: Summary) -> str:
    """By how many per cent each sensor's largest magnitude grows with one per cent of each parameter."""
    rows = []
    for name, entry in summary.sensors.items():
        key = "log_max" if abs(entry.max) >= abs(entry.min) else "log_min"
        peaks = (getattr(by.sensors[name], key) for by in summary.sensitivities.values())
        rows.append((name, *("-" if value is None else f"{round(value, 4) + 0.0:+.4f}" for value in peaks)))
    return table(("% of the peak by 1 % of", *summary.sensitivities), rows)
