"""Tables of a run's results, converted from SI to common units (millimetres, kilonewtons, degrees)."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Sequence
from typing import TYPE_CHECKING

import click
import numpy as np

from kaneflex.response.sensors import OF_RIGID
from kaneflex.support.errors import counted

if TYPE_CHECKING:
    from kaneflex.multibody.model.bound_model import Model
    from kaneflex.report.summary import Instant, SensorSummary, Summary
    from kaneflex.scene.modal_data import ModalData
    from kaneflex.solve.modes import Modes
    from kaneflex.solve.statespace import StateSpace

_MOST_POLES = 8
_FOR_PEOPLE = {  # SI unit: (unit shown, factor)
    "m": ("mm", 1e3),
    "N": ("kN", 1e-3),
    "Pa": ("MPa", 1e-6),
    "rad": ("deg", 180.0 / math.pi),
    "rad/s": ("deg/s", 180.0 / math.pi),
    "rad/s^2": ("deg/s^2", 180.0 / math.pi),
}
_NOTHING = 1e-12
"""Share of the root mean square below which a mean is rounding error."""
_WHEN_SMALL = {"m": (1e-6, "um", 1e6), "N": (10.0, "N", 1.0)}
"""SI unit -> limit below which values are shown in a smaller unit, this unit, and the factor to it."""
_WHEN_LARGE = {"N": (1e6, "MN", 1e-6), "N m": (1e4, "kN m", 1e-3)}
"""SI unit: values from there on are shown in that unit."""


def table(head: Sequence[str], rows: Sequence[Sequence[str]], left: int = 1) -> str:
    """Rows of text in aligned columns, the first ``left`` of them aligned to the left, under a bold header."""
    widths = [max(map(len, column)) for column in zip(head, *rows, strict=True)]

    def line(cells: Sequence[str]) -> str:
        sized = enumerate(zip(cells, widths, strict=True))
        return "  ".join(cell.ljust(size) if k < left else cell.rjust(size) for k, (cell, size) in sized).rstrip()

    return "\n".join([click.style(line(head), bold=True), *map(line, rows)])


def summary_table(summary: Summary) -> str:
    """Sensors of a run with their extremes and the instants of these."""
    return table(*sensor_cells(summary), left=2)


def sensor_cells(summary: Summary) -> tuple[tuple[str, ...], list[tuple[str, ...]]]:
    """Head and rows of that table."""
    at = "at s" if any(entry.at_min.drive_deg is None for entry in summary.sensors.values()) else "at deg"
    head = ("sensor", "unit", "min", at, "max", at, "mean", "rms")
    rows = [_sensor_row(name, entry) for name, entry in summary.sensors.items()]
    if all(entry.plus_minus is None for entry in summary.sensors.values()):
        return head, [row[:-1] for row in rows]
    return (*head, "+-"), rows


def unit_shown(unit: str, largest: float) -> tuple[str, Callable[..., str]]:
    """The unit for people of values up to ``largest`` (SI), and what writes an SI value in it, by so many digits."""
    shown, factor = unit_and_factor(unit, largest)

    def number(value: float, digits: int = 4) -> str:
        return f"{value * factor:.{digits}g}" if abs(value * factor) < 1e4 else f"{value * factor:.0f}"

    return shown, number


def unit_and_factor(unit: str, largest: float) -> tuple[str, float]:
    """The unit for people of values up to ``largest`` (SI), and how many of it are one SI unit."""
    if unit in _WHEN_SMALL and 0.0 < largest < _WHEN_SMALL[unit][0]:
        return _WHEN_SMALL[unit][1:]
    if unit in _WHEN_LARGE and largest >= _WHEN_LARGE[unit][0]:
        return _WHEN_LARGE[unit][1:]
    return _FOR_PEOPLE.get(unit, (unit, 1.0))


def _when(instant: Instant) -> str:
    """Angle of the drive [deg], or the time [s] if there is none."""
    return f"{instant.time_s:.5g}" if instant.drive_deg is None else f"{instant.drive_deg:.1f}"


def _sensor_row(name: str, entry: SensorSummary) -> tuple[str, ...]:
    unit, number = unit_shown(entry.unit, max(abs(entry.min), abs(entry.max)))
    lowest, highest = _when(entry.at_min), _when(entry.at_max)
    mean = 0.0 if abs(entry.mean) < _NOTHING * entry.rms else entry.mean
    off = "" if entry.plus_minus is None else number(entry.plus_minus.total, 2)
    return (name, unit, number(entry.min), lowest, number(entry.max), highest, number(mean), number(entry.rms), off)


def more_tables(summary: Summary) -> Iterator[tuple[str, str]]:
    """Titles and tables that only some runs have."""
    for title, found, as_table in (
        ("Matrices frozen at other angles", summary.mode_angle_spread, envelope_table),
        ("Contacts", summary.contacts, contact_table), ("Friction", summary.frictions, friction_table),
        ("Stresses", summary.stresses, stress_table), ("Sensitivities", summary.sensitivities, sensitivity_table),
    ):  # fmt: skip
        if found:
            yield title, as_table(summary)


def envelope_table(summary: Summary) -> str:
    """Peaks of a frozen model over the angle at which it is frozen."""
    rows = []
    for name, spread in summary.mode_angle_spread.items():
        unit, number = unit_shown(summary.sensors[name].unit, spread.largest)
        rows.append((name, unit, number(spread.smallest), number(spread.largest)))
    return table(("peaks for matrices of all angles", "unit", "smallest peak", "largest peak"), rows, left=2)


def contact_table(summary: Summary) -> str:
    """Table of the contacts; one without an entry on rest is open at the end."""
    rows = []
    for name, contact in summary.contacts.items():
        fastest, force = f"{contact.fastest_m_s or 0.0:.4g}", f"{contact.largest_force or 0.0:.5g}"
        if contact.largest_torque is not None:
            fastest, force = f"{contact.fastest_rad_s or 0.0:.4g} rad/s", f"{contact.largest_torque:.5g} N m"
        rest = "" if contact.rests_since_s is None else f"{contact.rests_since_s:.5g}"
        rows.append((name, f"{contact.impacts}", fastest, force, f"{contact.lost:.4g}", rest))
    return table(("contact", "impacts", "fastest m/s", "largest N", "lost J", "rests from s"), rows)


def friction_table(summary: Summary) -> str:
    """Table of the friction, with worn volumes if any are known."""
    rows, worn = [], any(friction.worn is not None for friction in summary.frictions.values())
    for name, friction in summary.frictions.items():
        turns = friction.largest_torque is not None
        largest = f"{friction.largest_torque:.5g} N m" if turns else f"{friction.largest_force:.5g} N"
        volume = "" if friction.worn is None else f"{1e9 * friction.worn:.4g}"
        rows.append((name, largest, f"{friction.lost:.4g}", f"{100 * friction.stuck:.3g}", *[volume] * worn))
    return table(("friction", "largest", "lost J", "stuck %", *["worn mm^3"] * worn), rows)


def stress_table(summary: Summary) -> str:
    """Largest stress in every link, with its place."""
    rows, unit = [], "deg" if any(each.at.drive_deg is not None for each in summary.stresses.values()) else "s"
    for name, stress in summary.stresses.items():
        share = "" if stress.utilisation is None else f"{100.0 * stress.utilisation:.3g}"
        rows.append((name, f"{1e-6 * stress.largest:.4g}", f"{1e3 * stress.x_m:.5g}", _when(stress.at), share))
    head = ("link", "largest stress MPa", "at mm", f"at {unit}", "% of yield_strength")
    held_against = any(stress.utilisation is not None for stress in summary.stresses.values())
    return table(head, rows) if held_against else table(head[:-1], [row[:-1] for row in rows])


def run_lines(summary: Summary) -> str:
    """Lines about a run: the model, the chosen solver if any, and the computing time."""
    timing = summary.timing
    parts = [f"{timing.set_up_s + timing.compile_s:.2f} s to set up", f"{timing.integrate_s:.2f} s to solve"]
    if timing.derive_s:
        parts.insert(0, f"{timing.derive_s:.2f} s to derive")
    if timing.ns_per_step:
        thousands = min(2, int(math.log10(max(1.0, timing.ns_per_step)) / 3))
        parts.append(f"{timing.ns_per_step / 1e3**thousands:.4g} {('ns', 'us', 'ms')[thousands]} a step")
    steps = f"{counted(summary.steps, 'step')} over {summary.duration_s:.6g} s"
    if summary.outcome != "completed" and not _is_whole(summary):
        reached = f"results over {summary.duration_s:.6g} s" if summary.stored else "none of them taken"
        steps = f"{counted(summary.steps, 'step')} requested, {reached}"
    solver = f"{summary.solver}\n" if summary.solver else ""
    rigid = [name for name, entry in summary.sensors.items()
             if entry.meaning.endswith(OF_RIGID) and f"{name}_rigid" in summary.sensors]  # fmt: skip
    if rigid:
        solver += f"{', '.join(rigid)} are those of the rigid mechanism: frozen equations hold at one instant only\n"
    if summary.errors:
        from kaneflex.solve.error_stages import REQUEST

        if summary.errors.endswith(REQUEST):  # other reasons leave no choice
            solver += f"errors of the sensors {summary.errors}\n"
    return (
        f"{summary.scene}, preset {summary.preset}: {counted(summary.degrees_of_freedom, 'degree of freedom')}, "
        f"{counted(summary.modes_kept, 'coordinate')} solved for, {steps}\n"
        f"{solver}{', '.join(parts)}"
    )


def ending(summary: Summary) -> str:
    """Sentence on the end of a run that was not completed; empty for completed runs."""
    if summary.outcome == "completed":
        return ""
    # a whole cycle, which any disturbance leaves
    message = summary.message
    return message[:1].upper() + message[1:] if _is_whole(summary) else f"Stopped early: {message}"


def _is_whole(summary: Summary) -> bool:
    return summary.duration_s > (1.0 - 1e-9) * summary.steps * summary.step_s


def modes_table(found: Modes) -> str:
    """Frequencies, and the coordinates that are displaced [m] and that turn [rad] most in each mode."""
    from kaneflex.solve.initial import start_dimensions
    from kaneflex.support.units import ANGLE

    model, coupled = found.model, found.model.options.dynamics == "coupled"
    names, moved = (list(found.coordinates), found.shapes) if coupled else _nodal(model, found.shapes)
    last = {name: name.rpartition(".")[2] for name in names}
    turning = {name for name, what in last.items() if what in ("theta", "turn", "phi", "angle") or "turn_" in what}
    turning |= {name for name, kind in start_dimensions(model).items() if kind is ANGLE}
    shifting = {name for name, what in last.items() if name not in turning and not what.startswith("mode_")}

    def largest(shape: np.ndarray, among: set[str]) -> str:
        sizes = {name: abs(x) for name, x in zip(names, shape, strict=True) if name in among}
        most = max(sizes.values(), default=0.0)
        # of what moves alike, the two ends of a beam, the first: rounding must not choose
        return next((name for name, size in sizes.items() if size >= (1 - 1e-6) * most), "none")

    rows = [
        (str(k + 1), f"{value:.3f}", largest(moved[:, k], shifting), largest(moved[:, k], turning))
        for k, value in enumerate(found.frequencies)
    ]
    head = ("mode", "Hz", "largest displacement", "largest rotation")
    where = model.reference_position
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
    """Slowest poles of a state space: frequency and damping ratio."""
    poles = system.poles[:_MOST_POLES]
    rows = [
        # + 0.0 removes the sign of a rounded zero
        (str(k), f"{abs(pole) / (2 * math.pi):.3f}", f"{round(-pole.real / abs(pole), 8) + 0.0:.3%}" if pole else "")
        for k, pole in enumerate(poles, start=1)
    ]
    return table(("pole", "Hz", "damping"), rows, left=0)


def _rounded(components: np.ndarray) -> str:
    """Components in a row; those of the size of rounding errors are zero."""
    least = 1e-9 * abs(components).max()
    return ", ".join(f"{x:.6g}" if abs(x) > least else "0" for x in components)


def imported_shapes(data: ModalData) -> tuple[str, dict[str, float]]:
    """Mass, centre and inertia of an imported link, and the frequency [Hz] of each of its shapes alone."""
    a, (mass, centre, inertia) = data.arrays, data.rigid
    words = f"{1e3 * data.length:.6g} mm from start to end, {mass:.6g} kg, centre of mass "
    if isinstance(inertia, tuple):
        moved, counts = np.einsum("aajj->j", a["mass_N_N"]), [("shape", len(a["stiffness"]))]
        at, about = (_rounded(of) for of in (1e3 * np.array(centre), np.array(inertia)))
        words += f"at ({at}) mm, moments of inertia about it ({about}) kg m^2"
    else:
        moved = np.concatenate([np.diag(a["mass_s_s"]), np.diag(a["mass_w_w"] + a["inertia_psi_psi"])])
        counts = [("axial", len(a["mass_s"])), ("transverse", len(a["mass_w"]))]
        words += f"{1e3 * centre[0]:.6g} mm from the start, moment of inertia about it {inertia:.6g} kg m^2"
    names = [f"{kind} {k + 1}" for kind, count in counts for k in range(count)]
    frequencies = np.sqrt(a["stiffness"] / moved) / (2 * math.pi)
    return words, dict(zip(names, frequencies.tolist(), strict=True))


def imported_table(data: ModalData) -> str:
    """The same as text."""
    words, frequencies = imported_shapes(data)
    rows = [(name, f"{hz:.1f}") for name, hz in frequencies.items()]
    return f"{words}\n{table(('shape', 'Hz'), rows)}"


def sensitivity_table(summary: Summary) -> str:
    """By how many per cent each sensor's largest magnitude grows with one per cent of each parameter."""
    rows = []
    for name, entry in summary.sensors.items():
        key = "log_max" if abs(entry.max) >= abs(entry.min) else "log_min"
        peaks = (getattr(by.sensors[name], key) for by in summary.sensitivities.values())
        rows.append((name, *("-" if value is None else f"{round(value, 4) + 0.0:+.4f}" for value in peaks)))
    return table(("% of the peak by 1 % of", *summary.sensitivities), rows)
