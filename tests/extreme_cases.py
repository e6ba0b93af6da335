"""The cases of the extremes suite."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
from extreme_checks import (
    ALUMINIUM,
    ALUMINIUM_DENSITY,
    BLADE_AREA,
    BLADE_I,
    CRANK,
    FIRST,
    ROD_AREA,
    STEEL,
    against,
    as_rigid_crank,
    blade,
    ended,
    forces,
    gas_alone,
    peak_of_spike,
    piston_at_rest,
    reaches_the_piston,
    same_rods,
    slow_blade,
    step_response,
    without_mass,
)
from extremes import METHODS, STEPPED, Case

ELASTIC = ("quasistatic", *STEPPED)


def _speeds() -> list[Case]:
    slow = [
        Case(
            "speed", f"{rpm} rpm: axial deflection compared with F l / (E A)", "engine",
            (f"main.speed={rpm} rpm", "solve.start=periodic", "solve.steps=400"), gas_alone, 1e-3,
            accurate=(*ELASTIC, "coupled") if rpm == "1" else ("quasistatic", "linear", "radau", "generalised-alpha"),
            named={} if rpm == "1" else {"newmark": "no periodic state"}, slow=("coupled",),
        )
        for rpm in ("1e-9", "1e-3", "1")
    ]  # fmt: skip
    common = ("solve.steps=2000", "damping.modal={ratio=0.02}")

    def scaled(factor: float) -> tuple[str, ...]:
        E, duration = 2e11 * factor**2, 53e-3 / factor
        beam = "rho=7870, A=28.27433388e-6, I=63.6172512e-12, elements=8"
        return f"main.speed={150 * factor!r}", f"rod.beam={{E={E!r}, {beam}}}", f"solve.duration={duration!r}", *common

    similar = [
        Case(
            "speed", f"{factor:g} times the speed and E times its square: equal motions", "slider-crank-150",
            scaled(factor), against(scaled(1.0), "mid_transverse"), 1e-6,
            accurate=("quasistatic", "paper", "linear", "radau", "newmark", "generalised-alpha", "coupled"),
            slow=("coupled",) if factor == 1e-6 else (),
        )
        for factor in (1e-6, 10.0)
    ]  # fmt: skip
    critical = FIRST * math.sqrt(ALUMINIUM * BLADE_I / (ALUMINIUM_DENSITY * BLADE_AREA))
    stepped = ("linear",)
    instability = [
        Case(
            "speed", f"{share:g} of the critical speed without K_g", "rotating-cantilever",
            (f"shaft.speed={share * critical!r}", "solve.start=periodic"), ended, 0.0,
            accurate=("radau", "newmark", "generalised-alpha", *(stepped if share < 1 else ())),
            named={} if share < 1 else dict.fromkeys(stepped, "unstable: the motion grows without bound"),
        )
        for share in (0.99, 1.01)
    ]  # fmt: skip
    standing = Case(
        "speed", "0 rpm without a duration", "engine", ("main.speed=0",), ended, 0.0, accurate=(),
        named=dict.fromkeys(("rigid", "quasistatic", "paper", "radau", "coupled"), "no rotating drive has a cycle"),
    )  # fmt: skip
    beyond = Case(
        "speed", "1e61 rad/s", "engine", ("main.speed=1e61",), ended, 0.0, accurate=(),
        named=dict.fromkeys(("rigid", "quasistatic", "paper", "radau", "coupled"), "outside 1e-60 to 1e+60"),
    )  # fmt: skip
    return [*slow, *similar, *instability, standing, beyond]


def _blades() -> list[Case]:
    found = []
    for slenderness in (5, 100, 1e4, 1e5):
        I = BLADE_AREA / slenderness**2
        found.append(
            Case(
                "slenderness", f"{slenderness:g}: tip deflection compared with F l^3 / (3 E I)", "rotating-cantilever",
                slow_blade(ALUMINIUM, I), blade(ALUMINIUM * I, 1e-6 * ALUMINIUM * I), 1e-5, accurate=ELASTIC,
                slow=ELASTIC if slenderness in (100, 1e4) else (),
            )
        )  # fmt: skip
    found += [
        Case(
            "Young's modulus", f"{E:g} Pa: tip deflection compared with F l^3 / (3 E I)",
            "rotating-cantilever", slow_blade(E, BLADE_I),
            blade(E * BLADE_I, 1e-6 * E * BLADE_I), 1e-5, accurate=ELASTIC,
        )
        for E in (1e6, 1e15)
    ]  # fmt: skip
    return found + [
        Case(
            "elements", f"{count}: tip deflection compared with F l^3 / (3 E I)", "rotating-cantilever",
            (*slow_blade(ALUMINIUM, BLADE_I), f"blade.elements={count}", "damping=none"),
            blade(ALUMINIUM * BLADE_I, 1e-6 * ALUMINIUM * BLADE_I), 1e-3 if count > 500 else 1e-5, accurate=ELASTIC,
            slow=() if count == 1 else STEPPED[:-1] if count == 256 else ELASTIC,
        )
        for count in (1, 64, 256, 1024)
    ]  # fmt: skip


def _dead_centres() -> list[Case]:
    found = [
        Case(
            "rod/crank", f"1 + {surplus:g}: piston position", "engine",
            (f"rod.length={CRANK * (1 + surplus)!r}", "loads.gas=none", "solve.start=zero", "solve.steps=7200"),
            reaches_the_piston, 1e-10, accurate=("rigid",), also=("quasistatic", *STEPPED),
        )
        for surplus in (1e-3, 1e-6, 1e-9)
    ]  # fmt: skip
    return found + [
        Case(
            "rod/crank", f"{ratio:g}: {what}", "engine", (f"rod.length={CRANK * ratio!r}",), ended, 0.0,
            accurate=(), named=dict.fromkeys(METHODS, said), slow=METHODS if ratio < 1 else (),
        )
        for ratio, what, said in (
            (1.0, "singular position", "singular"), (0.9, "the loop cannot close", "the loop cannot close"),
        )
    ]  # fmt: skip


def _masses() -> list[Case]:
    common = ("loads.gas=none", "damping=none", "solve.start=zero", "solve.duration=20 ms", "solve.steps=1440")
    heavy = [
        Case(
            "mass ratio", f"{mass} kg piston, 0.15 kg rod: stretch of the rod, piston at rest", "engine",
            (f"piston.mass={mass} kg", *common), piston_at_rest, 1e-3, accurate=("paper", "linear", "coupled"),
            also=("radau", "newmark", "generalised-alpha"), slow=METHODS if mass == "1e8" else ("coupled",),
        )
        for mass in ("1e8", "1e9")
    ]  # fmt: skip
    weightless = ("piston.mass=1e-12 kg", *common)
    light = Case(
        "mass ratio", "1e-9 kg piston, 0.15 kg rod: compared with a massless piston",
        "engine", ("piston.mass=1e-9 kg", *common), against(weightless, "tip_axial", "mid_transverse"), 1e-5,
        accurate=("quasistatic", "paper", "linear", "radau", "newmark", "generalised-alpha", "coupled"),
        slow=("coupled",),
    )  # fmt: skip
    return [*heavy, light]


def _dampings() -> list[Case]:
    common = (
        "shaft.speed=0", "blade.elements=3", "damping.rayleigh=none", "solve.start=zero", "solve.duration=0.8 s",
        "solve.steps=8000",
    )  # fmt: skip
    within = {"0": 1e-2, "0.05": 1e-3, "1": 1e-3, "1000": 1e-3}
    return [
        Case(
            "damping", f"{ratio} of critical: step response compared with the matrix exponential",
            "rotating-cantilever",
            (*common, f"damping.modal={{ratio={ratio}}}", "solve.terms.damping=true"), step_response, within[ratio],
            accurate=("paper", *STEPPED), slow=METHODS if ratio == "0.05" else (),
        )
        for ratio in within
    ]  # fmt: skip


def _steps() -> list[Case]:
    found = []
    for step in ("1e-9", "1e-3", "1e-1", "1e3"):
        common = (
            "shaft.speed=0", "blade.elements=3", "damping.modal={ratio=0.02}", "damping.rayleigh=none",
            "solve.start=zero", f"solve.duration={200 * float(step)!r}", "solve.steps=200", "solve.terms.damping=true",
        )  # fmt: skip
        found.append(
            Case(
                "step", f"{step} s: step response compared with the matrix exponential", "rotating-cantilever", common,
                step_response, 2e-2 if step == "1e-3" else 1e-3,
                accurate=("paper", *STEPPED) if step in ("1e-9", "1e-3") else ("paper",),
                also=STEPPED if step in ("1e-1", "1e3") else (),
            )
        )  # fmt: skip
    return found


def _modes() -> list[Case]:
    """Quasi-statically 3e-4 remain with all modes: what is left out are the accelerations of the coordinates.

    A joint's displacement carries the static shapes of its link with it, and turns with the mechanism; every node's
    own displacement turns with the link. Of two sets of coordinates, other accelerations are left out.
    """
    dynamic = tuple(method for method in ELASTIC if method != "quasistatic")
    return [
        Case(
            "modes", f"{count} of each link{quasistatic}: compared with all degrees of freedom", "engine",
            ("rod.elements=8", f"solve.modes={count}", "solve.reduction=craig-bampton"),
            against(("rod.elements=8",), "tip_axial", "mid_transverse"), within, accurate=methods,
            slow=methods if count == "6" else (),
        )
        for count in ("1", "6", "all")
        for quasistatic, methods, within in (("", dynamic, 2e-4), (", quasistatic", ("quasistatic",), 4e-4))
    ]  # fmt: skip


def _links() -> list[Case]:
    no_mass = ("rod.mass=none", f"rod.beam={{E={STEEL!r}, rho=1e-6, A={ROD_AREA!r}, I=7.008e-9, elements=4}}")
    rounding = {"newmark": "no periodic state: a Floquet multiplier equals one"}
    found = [
        Case(
            "links", f"a crank {factor:g} times as stiff as the rod: compared with a rigid crank",
            "engine-elastic-crank", (f"crank.beam={{E={STEEL * factor!r}, rho=7850, I=7.66008e-7, elements=2}}",),
            against((), "tip_axial", "mid_transverse", scene="engine"), 1e-6,
            accurate=("quasistatic", "linear", "radau", "generalised-alpha"), named=rounding,
            slow=ELASTIC if factor == 1e6 else (),
        )
        for factor in (1e6, 1e9)
    ]  # fmt: skip
    return [
        *found,
        Case(
            "links", "three rods of equal frequencies: equal motions", "engine-3", ("solve.start=periodic",),
            same_rods, 1e-6, accurate=ELASTIC,
        ),
        Case(
            "links", "a rod of 2e-11 kg: compared with -(F + m a) l / (E A)", "engine",
            (*no_mass, "solve.start=periodic", "damping.rayleigh=none", "damping.modal={ratio=0.02}"), without_mass,
            1e-2, accurate=ELASTIC,
        ),
        Case(
            "links", "a rod without mass", "engine", ("rod.mass=0",), ended, 0.0, accurate=(),
            named=dict.fromkeys(("rigid", "quasistatic", "paper", *STEPPED, "coupled"), "a mass must be above zero"),
        ),
    ]  # fmt: skip


CONVERGED = ("solve.integrator=generalised-alpha", "solve.steps=23040")
"""Second order, but it damps what it doesn't resolve, and sixteen times the default steps."""
ENGINE_FORCES = ("rod_force_piston", "crank_pin_force_y", "piston_side_force", "main_bearing_force_y", "crank_torque")
ENGINE_ACCELERATIONS = ("piston_acceleration", "rod_mid_acceleration_x", "rod_mid_acceleration_y")


def _forces() -> list[Case]:
    """Forces and accelerations: errors of displacements that are too small to be seen count there at any stiffness."""
    undamped, damped = ("newmark", "gauss"), ("linear", "radau", "generalised-alpha")
    measured = (*ENGINE_FORCES, *ENGINE_ACCELERATIONS)
    found = [
        Case(
            "forces", f"{count} elements: forces, accelerations compared with 4 elements, converged", "engine",
            (f"rod.elements={count}",), forces(CONVERGED, *measured), 2e-3, accurate=(*damped[1:], "coupled"),
            also=undamped, slow=(*undamped, "coupled") if count == 4 else METHODS,
        )
        for count in (4, 16, 64)
    ]  # fmt: skip
    start = "solve.start=quasistatic"
    found.append(
        Case(
            "forces", "256 elements, quasi-static start: forces, accelerations compared with 4 elements, converged",
            "engine", ("rod.elements=256", start), forces((start, *CONVERGED), *measured), 5e-3, accurate=damped[1:],
            also=undamped, slow=METHODS,
        )
    )  # fmt: skip
    found += [
        Case(
            "forces", "256 elements: forces, accelerations compared with 4 elements, converged", "engine",
            ("rod.elements=256",), forces(CONVERGED, *measured), 2e-3, accurate=("coupled",), slow=METHODS,
        ),
        Case(
            "forces", "1 element: forces, torque compared with 1 element, converged", "engine", ("rod.elements=1",),
            forces(("rod.elements=1", *CONVERGED), *ENGINE_FORCES), 2e-3, accurate=(*damped[1:], "coupled"),
            also=undamped,
        ),
    ]  # fmt: skip
    for rpm in (1, 6, 60, 600):
        speed = f"main.speed={rpm} rpm"
        found.append(
            Case(
                "forces", f"{rpm} rpm: forces, accelerations compared with quasi-static ones", "engine", (speed,),
                forces((speed, "solve.preset=quasistatic"), *measured), 5e-3,
                accurate=(*damped, "coupled") if rpm == 600 else damped, also=(*undamped, "coupled"),
                slow=METHODS if rpm == 1 else ("coupled",) if rpm < 600 else ("linear", "newmark", "coupled"),
            )
        )  # fmt: skip
    found.append(
        Case(
            "forces", "600 rpm, 64 elements: forces, accelerations compared with quasi-static ones", "engine",
            ("main.speed=600 rpm", "rod.elements=64"),
            forces(("main.speed=600 rpm", "solve.preset=quasistatic"), *measured), 5e-3,
            accurate=(*damped[1:], "coupled"), also=undamped, slow=METHODS,
        )
    )  # fmt: skip
    crank = ("crank_pin_force_x", "crank_pin_force_y", "main_bearing_force_x", "main_bearing_force_y")
    found += [
        Case(
            "forces", f"{count} elements of the crank: joint forces compared with 2 elements, converged",
            "engine-elastic-crank",
            (f"crank.elements={count}",), forces(CONVERGED, *crank), 5e-3, accurate=(*damped[1:], "coupled"),
            also=undamped, slow=METHODS if count > 8 else ("coupled",),
        )
        for count in (8, 12, 32)
    ]  # fmt: skip
    stiff = f"crank.beam={{E={STEEL * 1e6!r}, rho=7850, I=7.66008e-7, elements=2}}"
    for start in ("zero", "quasistatic"):
        found.append(
            Case(
                "forces",
                f"start = {start}, a crank 1e6 times as stiff as the rod: joint forces compared with a rigid crank",
                "engine-elastic-crank", (stiff, f"solve.start={start}"), as_rigid_crank(start, *crank), 2e-2,
                accurate=damped[1:] if start == "quasistatic" else ("radau",), also=("generalised-alpha", *undamped),
            )
        )  # fmt: skip
    return found


def spiked(table: Path, rows: np.ndarray, at: float) -> tuple[str, ...]:
    """Settings of the engine whose gas pushes with 100 kN at one angle [deg], with half of it 0.05 degrees beside."""
    force = 1e5 * np.maximum(0.0, 1.0 - abs(rows - at) / 0.1)
    table.write_text("deg,F\n" + "".join(f"{row:.2f},{F:.6g}\n" for row, F in zip(rows, force, strict=True)))
    return f"gas.table={table}", "gas.column=F"


def press(folder: Path) -> tuple[str, ...]:
    """Settings of the engine as a slow press: a turn a second, 50 kN at 103 degrees, none beyond 0.95 degrees of it."""
    rows = np.concatenate([np.arange(0, 100, 5.0), np.arange(100, 106.01, 0.05), np.arange(110, 361, 5.0)])
    force = 2.5e4 * (1 + np.cos(np.pi * np.clip((rows - 103) / 0.95, -1, 1)))
    table = folder / "press.csv"
    table.write_text("deg,F\n" + "".join(f"{row:.2f},{F:.6g}\n" for row, F in zip(rows, force, strict=True)))
    return (
        "main.speed=60 rpm", "main.cycle=360 deg", f"gas.table={table}", "gas.column=F", "gas.period=360 deg",
        "solve.start=zero",
    )  # fmt: skip


def spike_cases(folder: Path) -> list[Case]:
    """Forces shorter than a step and longer, of gas for 0.2 and of a press for 1.9 degrees; tables go to `folder`."""
    rows = np.concatenate([np.arange(0, 366, 5.0), np.arange(365.05, 374.99, 0.05), np.arange(375, 721, 5.0)])
    table = spiked(folder / "spike.csv", rows, 370.25)
    pulses = [
        Case(
            "spike", f"force over 1.9 deg, {steps} steps a turn: peak compared with F l / (E A)", "engine",
            (*press(folder), f"solve.steps={steps}"), peak_of_spike(103, 5e4), 1e-3,
            accurate=("quasistatic",) if steps > 180 else (), also=() if steps > 180 else ELASTIC,
        )
        for steps in (180, 2880)
    ]  # fmt: skip
    return pulses + [
        Case(
            "spike", f"gas force over 0.2 deg, {steps} steps a cycle: peak compared with F l / (E A)", "engine",
            (*table, "main.speed=60 rpm", f"solve.steps={steps}", "solve.start=zero"), peak_of_spike(370.25), 1e-3,
            accurate=("quasistatic",) if steps > 1440 else (), also=() if steps > 1440 else ELASTIC,
        )
        for steps in (1440, 28800)
    ] + [_pulse(folder)]  # fmt: skip


def _pulse(folder: Path) -> Case:
    """A press: 50 kN within 1.9 degrees of crank at 60 rpm, slow beside the rod, in default steps of half a degree."""
    rows, table = np.concatenate(([0.0], np.arange(360, 380.01, 0.1), [720.0])), folder / "pulse.csv"
    force = 5e4 * np.where(abs(rows - 370.25) < 1.9, np.cos(0.5 * np.pi * (rows - 370.25) / 1.9) ** 2, 0.0)
    table.write_text("deg,F\n" + "".join(f"{row:.2f},{F:.6g}\n" for row, F in zip(rows, force, strict=True)))
    settings = (f"gas.table={table}", "gas.column=F", "main.speed=60 rpm")
    return Case(
        "forces", "a pulse of 1.9 deg: forces compared with quasi-static ones", "engine", settings,
        forces((*settings, "solve.preset=quasistatic"), *ENGINE_FORCES), 1e-2, accurate=("radau", "generalised-alpha"),
        also=("linear", "newmark", "gauss"),
    )  # fmt: skip


CASES = (
    *_speeds(), *_blades(), *_dead_centres(), *_masses(), *_dampings(), *_steps(), *_modes(), *_links(), *_forces(),
)  # fmt: skip
"""Every case but those of `spike_cases`, which need a folder for their table."""
