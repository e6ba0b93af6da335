"""Warnings about results of runs that ended without an error."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace

import numpy as np

from kaneflex.integrate.system import Outcome, Trajectory
from kaneflex.multibody.model.bound_model import Model
from kaneflex.response.time_statistics import at_least, between_steps
from kaneflex.solve.linear_warnings import lost_stiffness, near_resonance
from kaneflex.solve.one_way_run import run_of, run_one_way, storing
from kaneflex.solve.run_result import RunResult, nominal_seconds
from kaneflex.support.errors import UserError, counted

ADDED_UP = 0.01
"""Share of a sensor's peak up to which the sum of step errors, each as large as the worst, is accepted without a
second run."""
COUPLING = 3.0
"""Relative change of a loop's stiffness per deflection as a share of the link's length: fitted to known differences of
`stiffened` and `coupled` (four-bar at 150 to 300 rpm, engine, slider-crank-150)."""
LEAST_DEFLECTION = 0.002
"""Deflection, as a share of a link's length, below which its effect on the motion is not checked."""
LONGEST_SECOND = 10.0
"""Nominal seconds of a run up to which it is solved a second time for a check."""
FEWEST_STEPS = 10
"""Steps per period of the lowest mode below which a run is reported as coarse."""
LARGEST_BEND = 0.1
"""Bending in a floating frame, as a share of a link's length, above which coupled equations are doubtful."""
LARGEST_COUPLING = 0.05
"""Largest accepted effect of deflections on the motion, as a share of a sensor's peak, if the equations neglect it."""
LARGEST_ERROR = 0.01
"""Tolerance of a coupled run's steps, as a share of its largest deformation, above which that is doubtful."""
LARGEST_GAP = 1e-4
"""Energy error of a run with free joints, as a share of the exchanged energy, that is accepted."""
LARGEST_PART, MEAN_PART = 0.05, 0.002
"""Accepted difference of a sensor computed in two ways, as a share of its peak: at one instant, as for a
start from rest, and in the root mean square."""
LARGEST_ROUNDING = 1e-5
"""Relative rounding error of a quasi-static solution that is accepted."""
LARGEST_STRETCH = 0.05
"""Relative change of a link's length above which small-displacement theory is doubtful."""
LARGEST_DEFLECTION = 0.05
"""Transverse displacement, as a share of a link's length, above which small-displacement theory is doubtful."""
STILL = 64 * np.finfo(float).eps
"""Share of a mechanism's size by which coordinates of a mechanism at rest may change."""
ZERO = 1e-6
"""Share of the largest reading in a unit below which a sensor's peak may be rounding error."""


def validity_warnings(solution: RunResult, frequencies: Sequence[float]) -> list[str]:
    """Warnings about a finished run: unresolved modes, large deflections, energy balance and others."""
    model, coupled = solution.model, solution.model.coupled is not None
    stepped = not getattr(solution.trajectory, "solver", "").startswith("spectral")  # harmonics resolve all modes
    found = [*foreseen(model, frequencies, solution.times, stepped)]
    found += [*_accuracy_warnings(solution), *_unbalanced(solution)]
    moved = _node_displacements(solution) if len(solution.times) else {}
    if coupled:
        found += [*_loose_tolerance(solution, moved), *_left_ringing(solution)]
        found += [*_missing_values(solution), *_jammed(solution)]
        from kaneflex.solve.touching import begun_anew, off_their_lines, undetermined_frictions

        found += [*off_their_lines(solution), *undetermined_frictions(solution), *begun_anew(solution)]
    if not len(solution.times):
        return found
    bends, lengths = model.options.dynamics == "coupled", {name: link.length for name, link in model.meshes.items()}
    shares = {name: float(np.hypot(*nodes[1:]).max()) / lengths[name] for name, nodes in moved.items()}
    for name, (u, *_) in moved.items():
        found += _deformed(name, lengths[name], u[-1] - u[0], shares[name], bends)
    found += near_resonance(solution)
    return found if coupled else found + _uncoupled(solution, shares)


def _node_displacements(solution: RunResult) -> dict[str, np.ndarray]:
    """Displacements u, v, w of the nodes of every elastic link, (3, n_nodes, n_times); in the plane w = 0."""
    motion, found = solution.motion, {}
    for name, link in solution.model.meshes.items():
        nodes = motion.nodes(name)
        nodes = nodes.reshape(len(link.nodes), link.dofs, -1).swapaxes(0, 1)[: link.dofs // 2 + link.dofs % 2]
        found[name] = np.concatenate([nodes, np.zeros((3 - len(nodes), *nodes.shape[1:]))])
    return found


def foreseen(model: Model, frequencies: Sequence[float], times: np.ndarray, stepped: bool) -> list[str]:
    """Warnings known without a solution: of steps, rounding, and stiffness reduced by forces.

    ``frequencies``: natural ones [Hz], ascending; ``times``: stored instants [s] (n,); ``stepped``: whether there are
    time steps.
    """
    lowest = next((frequency for frequency in frequencies if frequency > 0.0), None)
    found: list[str] = []
    if lowest is not None and stepped and model.options.dynamics in ("dynamic", "coupled"):
        found += few_steps(model, lowest)
    found += [*_ill_conditioned(model, times), *between_steps(model)]
    return found + lost_stiffness(model, times) if model.coupled is None and len(times) else found


def _deformed(name: str, length: float, stretched: np.ndarray, share: float, coupled: bool) -> Iterator[str]:
    """Warnings if a link's displacements are too large for the theory.

    ``stretched``: change of its length [m], (n_times,); ``share``: largest transverse displacement over its length.
    """
    stretch = abs(stretched).max() / length
    if stretch > LARGEST_STRETCH:
        yield (
            f"{name} stretches by {stretch:.2g} of its length: the theory assumes small strains, so its forces and "
            "frequencies are unreliable"
        )
    if coupled and share > LARGEST_BEND:
        yield (
            f"{name} bends by {share:.0%} of its length: its shortening is accurate to second order only, so compare "
            "with a geometrically exact model"
        )
    if not coupled and share > LARGEST_DEFLECTION:
        yield (
            f"{name} deflects by {share:.0%} of its length: the theory assumes small displacements, so compare with "
            "a geometrically exact model"
        )


def _unbalanced(solution: RunResult) -> Iterator[str]:
    """Warning if the energy balance of integrated free joints does not close."""
    energy, options = solution.energy, solution.model.options
    if energy is None or energy.drift <= LARGEST_GAP or _nothing_moved(solution):
        return
    missing = f"does not close: its error is {energy.drift:.2g} of the exchanged energy"
    if options.dynamics == "coupled":
        if solution.model.coupled is not None and not isinstance(solution.trajectory, Trajectory):
            from kaneflex.multibody.time.lost_branch import cause  # which few runs need

            if reason := cause(solution.model.coupled, solution.trajectory):
                yield f"the energy balance {missing}, {reason}"
                return
        more = ", or increase solve.steps" * (solution.model.coupled is not None)
        yield f"the energy balance {missing}; lower solve.tolerance from {options.tolerance:g}{more}"
    else:
        lower = f"lower solve.forward.tolerance from {options.forward_tolerance:g}"
        yield f"the energy balance of the rigid mechanism {missing}; {lower}"


def _nothing_moved(solution: RunResult) -> bool:
    """True if nothing moved except for rounding, for example held by friction: the energy error is then rounding."""
    system, trajectory = solution.model.coupled, solution.trajectory
    if system is None or isinstance(trajectory, Trajectory) or not len(solution.times):
        return False
    moved = np.ptp(trajectory.q, axis=0)
    return bool((moved <= STILL * (system.mechanism.size or 1.0)).all())


def _uncoupled(solution: RunResult, shares: dict[str, float]) -> list[str]:
    """Warning if the neglected effect of deflections on the motion matters.

    In a loop, a transverse deflection rotates forces and inertia by about its share of the link's length: the stiffness
    changes by about COUPLING times that share. The effect on the solution depends on resonance and is found by a second
    solution with that much change in stiffness. In open chains it is of second order. ``shares``: link -> largest
    transverse displacement as a share of its length.
    """
    model = solution.model
    share = max(shares.values(), default=0.0)
    in_loops = len(model.scene.joints) > len(model.scene.bodies)
    if not in_loops or share < LEAST_DEFLECTION or model.options.dynamics not in ("dynamic", "quasistatic"):
        return []
    if solution.outcome is not Outcome.COMPLETED or nominal_seconds(solution) > LONGEST_SECOND:
        return []
    equations, reduced = (
        replace(each, K_s=each.K_s * (1.0 + COUPLING * share)) for each in (model.equations, model.reduced)
    )
    try:
        other = run_one_way(replace(model, equations=equations, reduced=reduced))
    except UserError:  # close to having no such state, which is reported elsewhere
        return []
    if other.outcome is not Outcome.COMPLETED:
        return []
    worth = {name: apart.max(initial=0.0) for name, apart in _differences(solution, other).items()}
    # with the changed stiffness a pin's moment would not be zero
    zero = {name for name, (peak, least) in zip(solution.series, _peaks(solution), strict=True) if peak <= least}
    worth = {name: share for name, share in worth.items() if share > LARGEST_COUPLING and name not in zero}
    if not worth:
        return []
    worst, link = max(worth, key=worth.__getitem__), max(shares, key=shares.__getitem__)
    others = counted(len(worth) - 1, "other sensor")
    more = f", and {others} by more than {LARGEST_COUPLING:.0%}" if len(worth) > 1 else ""
    return [
        f"{link} deflects by {share:.1%} of its length: preset {model.options.preset} neglects the effect on the "
        f"motion, which changes {worst} by about {worth[worst]:.0%} of its peak{more}; compare with preset coupled"
    ]


def few_steps(model: Model, lowest: float) -> list[str]:
    """Warning if a period of the lowest mode [Hz] has too few steps, or too few stored instants."""
    per_period = 1.0 / (lowest * model.step)
    if per_period >= FEWEST_STEPS:
        return []
    cure = at_least(int(model.options.steps * FEWEST_STEPS / per_period) + 1, model.options)
    if model.coupled is not None:
        return [
            f"{per_period:.2g} stored instants in a period of the lowest mode ({lowest:.4g} Hz): stored results and "
            f"extremes do not resolve free vibrations, although the integration does; {cure}"
        ]
    return [
        f"{per_period:.2g} steps in a period of the lowest mode ({lowest:.4g} Hz): free vibrations are not "
        f"resolved; {cure}, unless only the slow response matters"
    ]


def _ill_conditioned(model: Model, times: np.ndarray) -> list[str]:
    """Warning if rounding may change quasi-static displacements and forces noticeably."""
    static = model.options.dynamics == "quasistatic" or (
        model.options.dynamics == "dynamic" and model.options.start == "quasistatic"
    )
    if not static or not len(times):
        return []
    from kaneflex.solve.quasistatic import lost_digits, mechanism_modes

    if mechanism_modes(model, times[0]):
        return []
    share = lost_digits(model, times[0])
    if share <= LARGEST_ROUNDING:
        return []
    return [
        f"the stiffness matrix is ill-conditioned: rounding may change the quasi-static solution by about "
        f"{share:.1g} of its value; make the stiffest links rigid, or use fewer elements"
    ]


def _accuracy_warnings(solution: RunResult) -> list[str]:
    """Warning if forces or accelerations computed in two ways differ: the difference estimates their error.

    The error of a single step shows in the accelerations, see `_by_velocities`. Accumulated errors, such as numerical
    damping of vibrations with ten steps per period, are at most the number of steps times that: if so much would
    matter, the run is repeated with half the step.
    """
    options, run = solution.model.options, solution.trajectory
    fixed = options.dynamics == "dynamic" and options.integrator != "spectral"
    if not fixed or solution.outcome is not Outcome.COMPLETED or len(run.times) < 4:
        return []
    parts = _differences(solution, _by_velocities(solution))
    found = _largest_difference(solution, "by the equations of motion and by differences of velocities", parts)
    added_up = options.steps * max((part.max() for part in parts.values()), default=0.0)
    seen = len(run.times) == options.steps + 1  # only if every step is stored
    if not found and (added_up > ADDED_UP or not seen) and nominal_seconds(solution) < LONGEST_SECOND:
        halved = _differences(solution, _in_half_steps(solution))
        found = _largest_difference(solution, "with steps of this length and of half of it", halved)
    cure = "give more solve.steps" + ("" if options.integrator == "radau" else ", or use integrator radau")
    if options.start != "periodic":
        cure += ", or use solve.start = quasistatic or periodic"
    return [
        f"{text}: the steps do not resolve the vibrations; displacements may be correct, but for accurate "
        f"forces and accelerations {cure}"
        for text in found
    ]


def _by_velocities(solution: RunResult) -> RunResult:
    """Solution with accelerations from differences of velocities.

    The equations of motion give accelerations from the residual of loads and stiffness, so that a tiny displacement
    error of an unresolved mode is multiplied by its stiffness. The velocities give independent accelerations, by
    Simpson's rule over two steps:

        (v_2 - v_0) / (2 h) = (a_0 + 4 a_1 + a_2) / 6 + O(h^4)

    Sensors are linear in the accelerations: they are read again with the difference.
    """
    run, step = solution.trajectory, solution.model.step
    even = abs(np.diff(run.times) / step - 1.0) < 1e-6  # not across skipped steps
    inner = (even[:-1] & even[1:])[:, None]
    apart = (run.v[2:] - run.v[:-2]) / (2.0 * step) - (run.a[:-2] + 4.0 * run.a[1:-1] + run.a[2:]) / 6.0
    by_velocities = run.a.copy()
    by_velocities[1:-1] += np.where(inner, apart, 0.0)
    return replace(solution, trajectory=replace(run, a=by_velocities))


def _in_half_steps(solution: RunResult) -> RunResult:
    """The same run with half the step, at the same instants; the given one if that run fails."""
    from kaneflex.integrate.run import integrate

    model = solution.model
    halved = replace(model, options=model.options._replace(steps=2 * model.options.steps))
    try:
        found = integrate(replace(run_of(halved), every=2 * storing(model)))
    except UserError:
        return solution
    return replace(solution, trajectory=found) if found.outcome is Outcome.COMPLETED else solution


def _differences(solution: RunResult, other: RunResult) -> dict[str, np.ndarray]:
    """Difference of every sensor in two runs, at common instants, as a share of its peak.

    Sensors that are zero up to rounding are compared with the largest reading of their unit.
    """
    count = min(len(solution.times), len(other.times))
    shared = solution.times[:count] == other.times[:count]  # one of them may have been ended by an event
    found = {}
    for (name, series), peak in zip(solution.series.items(), _peaks(solution), strict=True):
        found[name] = abs(other.series[name].values[:count] - series.values[:count])[shared] / (max(peak) or 1.0)
    return found


def _peaks(solution: RunResult) -> list[tuple[float, float]]:
    """Peak of each series, and that below which it may be rounding error: a share of the largest in its unit."""
    peaks = [(series.unit, float(abs(series.values).max())) for series in solution.series.values()]
    return [(peak, ZERO * max(other for of, other in peaks if of == unit)) for unit, peak in peaks]


def _largest_difference(solution: RunResult, ways: str, parts: dict[str, np.ndarray]) -> list[str]:
    """Sensor that differs most between two ways, with size and time; empty if differences are accepted."""
    largest = {name: (part.max(initial=0.0), np.sqrt(np.mean(part**2))) for name, part in parts.items() if len(part)}
    parted = [name for name, (one, mean) in largest.items() if one > LARGEST_PART or mean > MEAN_PART]
    if not parted:
        return []
    worst = max(parted, key=lambda name: largest[name][0])
    more = f", and {len(parted) - 1} more sensors differ" if len(parted) > 1 else ""
    at = solution.times[parts[worst].argmax()]
    return [f"{worst} computed {ways} differs by {largest[worst][0]:.2g} of its peak at t = {at:.6g} s{more}"]


def _missing_values(solution: RunResult) -> Iterator[str]:
    """Warnings of sensors without value in a coupled run."""
    for name, series in solution.series.items():
        lost = ~np.isfinite(series.values)
        if lost.any():
            yield (
                f"{name} has no value at {lost.sum()} of {len(lost)} instants, first at t = "
                f"{solution.times[lost.argmax()]:.6g} s: it is measured relative to the rigid mechanism, "
                "which does not close there"
            )


def _jammed(solution: RunResult) -> Iterator[str]:
    """Warnings of contacts that friction jams."""
    record = getattr(solution.trajectory, "frictions", None)
    for name, instant in () if record is None else zip(record.names, record.jams, strict=True):
        if np.isfinite(instant):
            yield (
                f"friction at {name} jams, first at t = {instant:.6g} s (Painleve's paradox): rigid sides would have "
                "no consistent contact force, or several; the computed force depends on the contact's stiffness"
            )


def _loose_tolerance(solution: RunResult, moved: Mapping[str, np.ndarray]) -> list[str]:
    """Warning if the tolerance of coupled steps is large compared with the largest deformation.

    ``moved``: displacements of the links' nodes.
    """
    from kaneflex.solve.coupled import mechanism_size

    model = solution.model
    if solution.trajectory.steps == 0:
        return []
    allowed = model.options.tolerance * mechanism_size(model)
    largest = max((float(abs(nodes).max()) for nodes in moved.values()), default=0.0)
    if allowed <= LARGEST_ERROR * largest or largest == 0.0:
        return []
    wanted = 0.1 * LARGEST_ERROR * largest / mechanism_size(model)
    return [
        f"solve.tolerance = {model.options.tolerance:g} allows errors of {allowed:.2g} m, but links deform by at most "
        f"{largest:.2g} m; lower it to {wanted:.0e} for accurate deformations and forces"
    ]


def _left_ringing(solution: RunResult) -> list[str]:
    """Warning if unresolved vibrations of a coupled run are large compared with slow accelerations.

    A mode that the steps don't resolve may vibrate with a displacement d up to the tolerance, an acceleration of
    omega^2 d. This is checked by a run with a tenth of the tolerance.
    """
    from kaneflex.solve.coupled import mechanism_size, simulate_coupled
    from kaneflex.solve.coupled_linearisation import left_by_gauss, unresolved

    model, series, found = solution.model, solution.series, left_by_gauss(solution)
    options, length = model.options, mechanism_size(model)
    peaks = [abs(series[name].values).max() * {"m/s^2": 1.0, "rad/s^2": length}[series[name].unit]
            for name, sensor in model.scene.sensors.items() if sensor.kind == "acceleration"]  # fmt: skip
    if not peaks or solution.outcome is not Outcome.COMPLETED:
        return found
    highest = 2.0 * np.pi * max((mode.frequency_hz for mode in unresolved(solution)), default=0.0)
    rings = options.tolerance * length * highest**2 > LARGEST_PART * min(peaks)
    if not rings or nominal_seconds(solution) > LONGEST_SECOND:
        return found
    tenth = 0.1 * options.tolerance
    other = simulate_coupled(replace(model, options=options._replace(tolerance=tenth)))
    parts = _differences(solution, other) if other.outcome is Outcome.COMPLETED else {}
    return found + [
        f"{text}: vibrations below the tolerance affect accelerations; lower solve.tolerance, or use preset "
        "stiffened"
        for text in _largest_difference(solution, f"at solve.tolerance = {options.tolerance:g} and {tenth:g}", parts)
    ]
