"""What should make a user doubt a result that came out without an error."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace

import numpy as np

from kaneflex.integrate.outcome import Outcome, Trajectory
from kaneflex.multibody.model import Model
from kaneflex.response.frozen import lost_stiffness
from kaneflex.response.undersampling import at_least, between_steps
from kaneflex.scene.options import moves_with_links
from kaneflex.solve.quasistatic import lost_digits, mechanism_modes
from kaneflex.solve.resonance import near_resonance
from kaneflex.solve.solution import Solution
from kaneflex.solve.touching import undetermined_frictions
from kaneflex.solve.work import nominal_seconds
from kaneflex.support.errors import UserError

ADDED_UP = 0.01
"""Share of a sensor's peak that steps may add up to, were each as wrong as the worst of them, without a second run."""
COUPLING = 3.0
"""Relative change of a loop's stiffness by a deflection, over that deflection as a share of the link's length: what
fits best where `stiffened` and `coupled` are known to part (four-bar at 150 to 300 rpm, engine, slider-crank-150)."""
LEAST_DEFLECTION = 0.002
"""Deflection, as a share of a link's length, below which no resonance is looked for that would enlarge its worth."""
LONGEST_SECOND = 10.0
"""Nominal seconds of a run up to which another one is solved only to find out what could be wrong with it."""
FEWEST_STEPS = 10
"""Steps in a period of the lowest mode below which a run is said to be coarse."""
LARGEST_BEND = 0.1
"""Bending in a floating frame, as a share of a link's length, beyond which coupled equations are in doubt."""
LARGEST_COUPLING = 0.05
"""Share of a sensor's peak that what deflections do to the motion may be worth, unless the equations know it."""
LARGEST_ERROR = 0.01
"""Error allowed in a coupled run's steps, as a share of its largest deformation, beyond which that is in doubt."""
LARGEST_GAP = 1e-4
"""Share of the energy turned over that a run with free joints may lose or gain without a word."""
LARGEST_PART, MEAN_PART = 0.05, 0.002
"""Share of a sensor's peak by which its values found in two ways may part, at one instant, as where a start from rest
is a shock, and in the root mean square of all."""
LARGEST_ROUNDING = 1e-5
"""Share of a quasi-static answer that rounding may change without a word."""
LARGEST_STRETCH = 0.05
"""Change of a link's length, as a share of it, beyond which small-displacement theory is in doubt."""
LARGEST_DEFLECTION = 0.05
"""Transverse displacement, as a share of a link's length, beyond which small-displacement theory is in doubt."""
STILL = 64 * np.finfo(float).eps
"""Share of a mechanism's size by which its coordinates may change where it stands still."""
ZERO = 1e-6
"""Share of the largest reading in a unit below which a sensor's peak may be rounding."""


def validity_warnings(solution: Solution, frequencies: Sequence[float]) -> list[str]:
    """Warnings about a finished run: a step too long for its lowest mode, deflections too large for the theory."""
    model, coupled = solution.model, solution.model.coupled is not None
    stepped = not getattr(solution.trajectory, "solver", "").startswith("spectral")  # harmonics leave no mode out
    found = [*foreseen(model, frequencies, solution.times, stepped), *_parted(solution), *_unbalanced(solution)]
    if coupled:
        found += [*_loose(solution), *_left_ringing(solution), *_lost(solution), *_jammed(solution)]
        from kaneflex.solve.contact_lines import off_their_lines

        found += [*off_their_lines(solution), *undetermined_frictions(solution)]
    if not len(solution.times):
        return found
    motion = solution.motion
    nodes = {name: motion.nodes(name) for name in model.links}
    shares = {}
    for name, q in nodes.items():
        link = model.links[name]
        of_node = q.reshape(len(link.nodes), -1, q.shape[1])  # u, v, theta; in space u, v, w and three rotations
        across = abs(of_node[:, 1]) if link.dofs == 3 else np.hypot(of_node[:, 1], of_node[:, 2])
        shares[name] = float(across.max()) / link.length
        found += _deformed(name, link.length, of_node[-1, 0] - of_node[0, 0], shares[name], coupled)
    found += near_resonance(solution)
    return found if coupled else found + _uncoupled(solution, shares)


def foreseen(model: Model, frequencies: Sequence[float], times: np.ndarray, stepped: bool) -> list[str]:
    """Warnings that are known without a solution: of steps, of rounding, and of stiffness that forces take away.

    frequencies: natural ones [Hz], rising; times: stored instants [s] (n,); stepped: whether steps are taken
    """
    lowest = next((frequency for frequency in frequencies if frequency > 0.0), None)
    found: list[str] = []
    if lowest is not None and stepped and model.options.dynamics in ("dynamic", "coupled"):
        found += few_steps(model, lowest)
    found += [*_ill_conditioned(model, times), *between_steps(model)]
    return found + lost_stiffness(model, times) if model.coupled is None and len(times) else found


def _deformed(name: str, length: float, stretched: np.ndarray, share: float, coupled: bool) -> Iterator[str]:
    """Warnings where a link's displacements are too large for what is made of them.

    stretched: by how much it is longer [m], (n_times,); share: of its length, by which it moves across its axis at most
    """
    stretch = abs(stretched).max() / length
    if stretch > LARGEST_STRETCH:
        yield (
            f"{name} stretches by {stretch:.2g} of its length: strains are taken as small, so its forces and "
            "frequencies mean little"
        )
    if coupled and share > LARGEST_BEND:
        yield (
            f"{name} bends out of its own axis by {share:.0%} of its length: its shortening is "
            "complete to the second order only, so compare with a geometrically exact model"
        )
    if not coupled and share > LARGEST_DEFLECTION:
        yield (
            f"{name} moves across its axis by {share:.0%} of its length: displacements are "
            "taken as small, so compare with a geometrically exact model"
        )


def _unbalanced(solution: Solution) -> Iterator[str]:
    """A warning where the energy of what was integrated with free joints gets lost or comes from nowhere."""
    energy, options = solution.energy, solution.model.options
    if energy is None or energy.drift <= LARGEST_GAP or _stood(solution):
        return
    missing = f"does not close: {energy.drift:.2g} of the energy turned over is missing or too much"
    if moves_with_links(solution.model.scene, options.dynamics):
        if solution.model.coupled is not None and not isinstance(solution.trajectory, Trajectory):
            from kaneflex.multibody.lost_branch import cause  # which few runs need

            if said := cause(solution.model.coupled, solution.trajectory):
                yield f"the energy balance {missing}, {said}"
                return
        more = ", or ask for more steps" * (solution.model.coupled is not None)
        yield f"the energy balance {missing}; lower solve.tolerance from {options.tolerance:g}{more}"
    else:
        lower = f"lower solve.forward.tolerance from {options.forward_tolerance:g}"
        yield f"the energy balance of the rigid mechanism {missing}; {lower}"


def _stood(solution: Solution) -> bool:
    """Whether nothing moved but by rounding, as where friction holds it: all energy that was turned over is rounding's.
    """
    system, trajectory = solution.model.coupled, solution.trajectory
    if system is None or isinstance(trajectory, Trajectory) or not len(solution.times):
        return False
    moved = np.ptp(trajectory.q, axis=0)
    return bool((moved <= STILL * (system.mechanism.size or 1.0)).all())


def _uncoupled(solution: Solution, shares: dict[str, float]) -> list[str]:
    """A warning where it matters that the motion acts on the deflections, but they don't act on the motion.

    In a loop a link that moves across its axis by a share of its length turns the forces and the inertia of what it
    holds by about that angle: the equations change by some COUPLING times the share. How much the answer changes with
    them is a matter of resonance, a fold of it or a hundred, and is found by solving once more with a stiffness that
    differs by as much. In open chains the change is of second order in the share.

    shares: link -> largest displacement across its axis, as a share of its length
    """
    model = solution.model
    share = max(shares.values(), default=0.0)
    in_loops = len(model.scene.joints) > len(model.scene.bodies)
    if not in_loops or share < LEAST_DEFLECTION or model.options.dynamics not in ("dynamic", "quasistatic"):
        return []
    if solution.outcome is not Outcome.COMPLETED or nominal_seconds(solution) > LONGEST_SECOND:
        return []
    from kaneflex.solve.simulation import solve

    equations, reduced = (
        replace(each, K_s=each.K_s * (1.0 + COUPLING * share)) for each in (model.equations, model.reduced)
    )
    try:
        other = solve(replace(model, equations=equations, reduced=reduced))
    except UserError:  # at the brink of having no such state, which is said elsewhere
        return []
    if other.outcome is not Outcome.COMPLETED:
        return []
    worth = {name: apart.max(initial=0.0) for name, apart in _apart(solution, other).items()}
    zero = _zero(solution)  # forces are read with the links' own stiffness, so that a pin's moment would not be zero
    worth = {name: share for name, share in worth.items() if share > LARGEST_COUPLING and name not in zero}
    if not worth:
        return []
    worst, link = max(worth, key=worth.__getitem__), max(shares, key=shares.__getitem__)
    more = f", and more than {LARGEST_COUPLING:.0%} of that of {len(worth) - 1} sensors more" if len(worth) > 1 else ""
    return [
        f"{link} moves across its axis by {share:.1%} of its length: what that does to the motion, which preset "
        f"{model.options.preset} leaves out, is worth some {worth[worst]:.0%} of the peak of {worst}{more}; compare "
        "with preset coupled"
    ]


def few_steps(model: Model, lowest: float) -> list[str]:
    """A warning where a period of the lowest mode [Hz] has few steps, or few of the instants that are stored."""
    per_period = 1.0 / (lowest * model.step)
    if per_period >= FEWEST_STEPS:
        return []
    cure = at_least(int(model.options.steps * FEWEST_STEPS / per_period) + 1, model.options)
    if model.coupled is not None:
        return [
            f"{per_period:.2g} stored instants in a period of the lowest mode ({lowest:.4g} Hz): the run follows free "
            f"vibrations between them, but neither its results nor their extremes show them; {cure}"
        ]
    return [
        f"{per_period:.2g} steps in a period of the lowest mode ({lowest:.4g} Hz): free vibrations are not "
        f"resolved; {cure}, unless only the slow response matters"
    ]


def _ill_conditioned(model: Model, times: np.ndarray) -> list[str]:
    """A warning where rounding alone may change quasi-static displacements, forces and torques."""
    static = model.options.dynamics == "quasistatic" or (
        model.options.dynamics == "dynamic" and model.options.start == "quasistatic"
    )
    if not static or not len(times) or mechanism_modes(model, times[0]):
        return []
    share = lost_digits(model, times[0])
    if share <= LARGEST_ROUNDING:
        return []
    return [
        f"the stiffness is ill-conditioned: rounding alone may change the quasi-static answer by some {share:.1g} of "
        "it; make the stiffest links rigid, or give fewer elements"
    ]


def _parted(solution: Solution) -> list[str]:
    """A warning where forces or accelerations found in two ways part: then they are no truer than that.

    What a single step does is seen in the accelerations, by `_by_velocities`. What many steps add up, as where
    vibrations of ten steps a period lose a little in each of them, is seen in no single one, but it is not more than
    their number times that: where so much would matter, the run is repeated in steps half as long.
    """
    options, run = solution.model.options, solution.trajectory
    fixed = options.dynamics == "dynamic" and options.integrator not in ("scipy", "spectral")
    if not fixed or solution.outcome is not Outcome.COMPLETED or len(run.times) < 4:
        return []
    parts = _apart(solution, _by_velocities(solution))
    said = _part_by(solution, "by the equations of motion and by the change of velocities", parts)
    added_up = options.steps * max((part.max() for part in parts.values()), default=0.0)
    seen = len(run.times) == options.steps + 1  # where not every step is stored, none is seen
    if not said and (added_up > ADDED_UP or not seen) and nominal_seconds(solution) < LONGEST_SECOND:
        halved = _apart(solution, _in_half_steps(solution))
        said = _part_by(solution, "in steps of this length and of half of it", halved)
    cure = "give more solve.steps" + ("" if options.integrator == "radau" else ", or take integrator radau")
    if options.start != "periodic":
        cure += ", or start on the slow motion, by solve.start = quasistatic or periodic"
    return [
        f"{text}: vibrations are excited that the steps don't resolve; displacements may be right, but for forces and "
        f"accelerations {cure}"
        for text in said
    ]


def _by_velocities(solution: Solution) -> Solution:
    """The solution with accelerations by the change of velocities.

    The equations of motion give accelerations from what loads and stiffness leave unbalanced, so that an error of a
    displacement far too small to be seen, of a mode that the steps don't resolve, counts at that mode's stiffness. The
    velocities know another acceleration, by Simpson's rule over two steps:

        (v_2 - v_0) / (2 h) = (a_0 + 4 a_1 + a_2) / 6 + O(h^4)

    Sensors are linear in the accelerations: they are read once more with what lies between the two.
    """
    run, step = solution.trajectory, solution.model.step
    even = abs(np.diff(run.times) / step - 1.0) < 1e-6  # not where steps were left out
    inner = (even[:-1] & even[1:])[:, None]
    apart = (run.v[2:] - run.v[:-2]) / (2.0 * step) - (run.a[:-2] + 4.0 * run.a[1:-1] + run.a[2:]) / 6.0
    by_velocities = run.a.copy()
    by_velocities[1:-1] += np.where(inner, apart, 0.0)
    return replace(solution, trajectory=replace(run, a=by_velocities))


def _in_half_steps(solution: Solution) -> Solution:
    """The same run in steps half as long, at the same instants; itself where it does not complete in those."""
    from kaneflex.integrate.run import integrate
    from kaneflex.solve.simulation import run_of, storing

    model = solution.model
    halved = replace(model, options=replace(model.options, steps=2 * model.options.steps))
    try:
        found = integrate(replace(run_of(halved), every=2 * storing(model)))
    except UserError:
        return solution
    return replace(solution, trajectory=found) if found.outcome is Outcome.COMPLETED else solution


def _apart(solution: Solution, other: Solution) -> dict[str, np.ndarray]:
    """Difference of every sensor in two runs, at the instants that both have, as a share of its peak.

    What is zero but for rounding has none of its own: it is measured against what else there is in its unit.
    """
    count = min(len(solution.times), len(other.times))
    shared = solution.times[:count] == other.times[:count]  # one of them may have been ended by an event
    found, peaks, least = {}, _peaks(solution), _least_peaks(solution)
    for name, series in solution.series.items():
        largest = max(peaks[name], least[series.unit]) or 1.0
        found[name] = abs(other.series[name].values[:count] - series.values[:count])[shared] / largest
    return found


def _zero(solution: Solution) -> set[str]:
    """Sensors that may be zero but for rounding."""
    peaks, least = _peaks(solution), _least_peaks(solution)
    return {name for name, series in solution.series.items() if peaks[name] <= least[series.unit]}


def _peaks(solution: Solution) -> dict[str, float]:
    return {name: float(abs(series.values).max()) for name, series in solution.series.items()}


def _least_peaks(solution: Solution) -> dict[str, float]:
    """By unit the peak below which a sensor's may be rounding: a share of the largest."""
    found: dict[str, float] = {}
    for name, peak in _peaks(solution).items():
        unit = solution.series[name].unit
        found[unit] = max(found.get(unit, 0.0), ZERO * peak)
    return found


def _part_by(solution: Solution, ways: str, parts: dict[str, np.ndarray]) -> list[str]:
    """Which sensor, found in two ways, parts most, by how much and when; nothing where none does by too much."""
    largest = {name: (part.max(initial=0.0), np.sqrt(np.mean(part**2))) for name, part in parts.items() if len(part)}
    parted = [name for name, (one, mean) in largest.items() if one > LARGEST_PART or mean > MEAN_PART]
    if not parted:
        return []
    worst = max(parted, key=lambda name: largest[name][0])
    more = f", and {len(parted) - 1} more of the sensors" if len(parted) > 1 else ""
    at = solution.times[parts[worst].argmax()]
    return [f"{worst} {ways} part by {largest[worst][0]:.2g} of its peak at t = {at:.6g} s{more}"]


def _lost(solution: Solution) -> Iterator[str]:
    """Warnings where sensors of a coupled run have no value."""
    for name, series in solution.series.items():
        lost = ~np.isfinite(series.values)
        if lost.any():
            yield (
                f"{name} has no value at {lost.sum()} of {len(lost)} instants, first at t = "
                f"{solution.times[lost.argmax()]:.6g} s: the deformed mechanism is then where the rigid one, which it "
                "is measured against, doesn't close"
            )


def _jammed(solution: Solution) -> Iterator[str]:
    """Warnings where friction presses the sides of contacts into each other."""
    record = getattr(solution.trajectory, "frictions", None)
    for name, instant in () if record is None else zip(record.names, record.jams, strict=True):
        if np.isfinite(instant):
            yield (
                f"friction at {name} presses its sides into each other, first at t = {instant:.6g} s (Painleve's "
                "paradox): between rigid ones no force would agree with it, or several would; how hard these jam is "
                "up to the contact's stiffness"
            )


def _loose(solution: Solution) -> list[str]:
    """A warning where the error allowed in coupled steps is no small part of the largest deformation."""
    from kaneflex.solve.coupled import longest

    model, motion = solution.model, solution.motion
    if solution.trajectory.steps == 0:
        return []
    allowed = model.options.tolerance * longest(model.scene)
    moved = (np.delete(motion.nodes(name), np.s_[2::3], axis=0) for name in model.links)
    largest = max((abs(series).max() for series in moved), default=0.0)
    if allowed <= LARGEST_ERROR * largest or largest == 0.0:
        return []
    wanted = 0.1 * LARGEST_ERROR * largest / longest(model.scene)
    return [
        f"solve.tolerance = {model.options.tolerance:g} allows errors of {allowed:.2g} m where no link deforms by more "
        f"than {largest:.2g} m; lower it to {wanted:.0e} for the deformation and its forces"
    ]


def _left_ringing(solution: Solution) -> list[str]:
    """A warning where vibrations that the tolerance leaves to a coupled run count beside slow accelerations.

    A mode that the steps don't follow may ring by the displacement d that is allowed, which is an acceleration of
    omega^2 d. Whether it does is found by a run with a tenth of the tolerance.
    """
    from kaneflex.solve.coupled import longest
    from kaneflex.solve.unresolved import left_by_gauss, unresolved

    model, series, found = solution.model, solution.series, left_by_gauss(solution)
    options, length = model.options, longest(model.scene)
    peaks = [abs(series[name].values).max() * {"m/s^2": 1.0, "rad/s^2": length}[series[name].unit]
            for name, sensor in model.scene.sensors.items() if sensor.kind == "acceleration"]  # fmt: skip
    if not peaks or solution.outcome is not Outcome.COMPLETED:
        return found
    highest = 2.0 * np.pi * max((mode.frequency_hz for mode in unresolved(solution)), default=0.0)
    rings = options.tolerance * length * highest**2 > LARGEST_PART * min(peaks)
    if not rings or nominal_seconds(solution) > LONGEST_SECOND:
        return found
    from kaneflex.solve.simulation import solve

    tenth = 0.1 * options.tolerance
    other = solve(replace(model, options=replace(options, tolerance=tenth)))
    parts = _apart(solution, other) if other.outcome is Outcome.COMPLETED else {}
    return found + [
        f"{text}: vibrations smaller than the error allowed count in accelerations; lower solve.tolerance, or take "
        "preset stiffened"
        for text in _part_by(solution, f"at solve.tolerance = {options.tolerance:g} and {tenth:g}", parts)
    ]
