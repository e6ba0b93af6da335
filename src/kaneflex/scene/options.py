"""Presets: the terms that each keeps of the equations, and all options of a run."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any, NamedTuple

from kaneflex.scene import Scene
from kaneflex.scene.option_check import check_contacts, check_coupled, check_laws
from kaneflex.scene.parts import Solve
from kaneflex.support.errors import SceneError

DEFAULT_MODES = 3
"""Default number of fixed-interface modes of a link in the coupled equations."""
STEPS_PER_TURN = 720
"""Default resolution: half a degree of the fastest drive."""
PAPER_DURATION = 0.04
"""The paper's horizon [s], Figs. 18-28: four turns at 6000 rpm."""


class Options(NamedTuple):
    """All options of a run of a scene.

    Attributes
    ----------
    preset : str
        Preset that gave the defaults.
    dynamics : str
        "rigid" (no deformation), "quasistatic" (K z = F at each instant), "frozen" (constant coefficients, decoupled,
        paper (143)) or "dynamic" (time-varying coefficients).
    spin, gyroscopic, euler, geometric, damping : bool
        Complete term groups: proportional to omega^2, omega, epsilon, the axial force, and the material damping.
    rotary, shear, gravity : bool
        Optional groups of a scene, in both stages: rotary inertia of the sections, their shear, gravity.
    convective : bool
        Keep T' and T'' of the joint displacements' transformation.
    weld_pins, free_drives : bool
        Share the elastic rotation at pins between elastic links; leave it free at drives.
    elements : int or None
        Elements of every link; None keeps each link's own number.
    foreshortening : bool
        Displacements include the shortening of the bent axis, -1/2 int v'^2 dx.
    reduction : str
        "none", "craig-bampton" (each link, in its own axes) or "modal" (modes of the whole mechanism at mode_angle).
    modes : int or "all"
        Modes kept: of each link, or of the mechanism.
    mode_angle : float
        Angle of the first drive at which reference modes are taken and the frozen model is frozen [rad].
    start : str
        "zero", "quasistatic", "periodic", or "given" if the scene gives a state.
    integrator : str
        Name in ``kaneflex.integrate.methods.METHODS``.
    steps : int
        Steps per cycle, or per run without a cycle.
    cycles : bool
        True if ``steps`` are per cycle.
    duration : float
        Horizon of the run [s].
    rho_infinity : float
        Spectral radius of generalised-alpha at infinite frequency.
    tolerance : float
        Coupled equations: error that ten periods of a vibration accumulate, as a share of the longest body, and in
        rad. Integrator spectral: relative error of the motion in the energy norm.
    bounded : tuple of str
        Further quantities bounded at every step, as a share of their largest value so far: "speeds", "reactions".
    forward_tolerance : float
        Relative tolerance for free joints that are integrated before anything deforms; in space as ``tolerance`` of
        coupled equations.
    errors : str
        Errors of the sensors that are estimated: "quick" (none that takes several times a long run), "total",
        "all" (with parts and coupling) or "none".
    """

    preset: str
    dynamics: str
    spin: bool
    gyroscopic: bool
    euler: bool
    geometric: bool
    damping: bool
    rotary: bool
    shear: bool
    gravity: bool
    convective: bool
    weld_pins: bool
    free_drives: bool
    elements: int | None
    foreshortening: bool
    reduction: str
    modes: int | str
    mode_angle: float
    start: str
    integrator: str
    steps: int
    cycles: bool
    duration: float
    rho_infinity: float
    tolerance: float
    bounded: tuple[str, ...]
    forward_tolerance: float
    errors: str

    def as_dict(self) -> dict[str, object]:
        """Options by name, as plain data."""
        return {name: list(value) if isinstance(value, tuple) else value for name, value in self._asdict().items()}


_ALL = dict.fromkeys(
    ("spin", "gyroscopic", "euler", "geometric", "damping", "convective", "rotary", "shear", "gravity"), True
)
_ELASTIC_TERMS = ("spin", "gyroscopic", "euler", "geometric", "damping")
_RIGID = {"rotary": True, "gravity": True}  # the groups that also affect the rigid mechanism
_PRESETS: dict[str, dict[str, Any]] = {
    "rigid": dict.fromkeys(_ALL, False) | _RIGID | {"dynamics": "rigid", "foreshortening": False},
    # Without any damping, since C_s L' would be an unphysical force.
    "quasistatic": _ALL | {"gyroscopic": False, "damping": False, "dynamics": "quasistatic", "foreshortening": True},
    "paper": _ALL
    | {"gyroscopic": False, "geometric": False, "damping": False, "convective": False, "dynamics": "frozen"}
    | {"foreshortening": False, "weld_pins": True, "free_drives": True, "elements": 1},
    "linear": _ALL | {"geometric": False, "dynamics": "dynamic", "foreshortening": False},
    "stiffened": _ALL | {"dynamics": "dynamic", "foreshortening": True},
    # Its displacements are those of the bent axis: the foreshortening is in the equations.
    "coupled": _ALL | {"dynamics": "coupled", "foreshortening": False},
}
UNUSED_TERMS = {
    "rigid": tuple(name for name in _ALL if name not in _RIGID),
    "quasistatic": ("gyroscopic", "damping"),
    "frozen": ("gyroscopic",),
    "dynamic": (),
    "coupled": (),
}
"""Term groups that each kind of dynamics always omits."""
_INTEGRATOR = {"rigid": "none", "quasistatic": "none", "frozen": "exact-modal", "dynamic": "radau", "coupled": "radau"}
_TOLERANCES = {"coupled": 1e-8, "dynamic": 1e-6}


def resolve_options(scene: Scene) -> Options:
    """Options of the scene: its preset, overridden by its settings.

    Raises
    ------
    SceneError
        If settings contradict each other; it names both.
    """
    solve = scene.solve
    chosen: dict[str, Any] = {"weld_pins": False, "free_drives": False, "elements": None} | _PRESETS[solve.preset]
    dynamics = str(chosen["dynamics"])
    for name, on in solve.terms.items():
        chosen[name] = on and name not in UNUSED_TERMS[dynamics]
    modal = next((name for name, body in scene.bodies.items() if body.modal is not None), None)
    if modal is not None and dynamics not in ("rigid", "coupled"):
        raise SceneError(
            f"bodies.{modal}.modal_data", Path(scene.bodies[modal].modal_data).name,
            f"preset {solve.preset} needs a link's finite elements, not modal data",
            "Use preset coupled or rigid, or give the body a beam",
        )  # fmt: skip
    elastic = modal is not None or scene.is_elastic
    if elastic and scene.is_frame and solve.preset == "rigid":
        raise SceneError(
            "solve.preset", "rigid",
            "a fixed structure has no rigid motion, and may be statically indeterminate",
            "Use preset quasistatic, linear or stiffened",
        )  # fmt: skip
    if not elastic and (dynamics != "coupled" or scene.is_frame):
        dynamics, chosen["dynamics"] = "rigid", "rigid"
    if dynamics == "coupled":
        check_coupled(scene)
    check_contacts(scene, dynamics)
    check_laws(scene, dynamics)
    paper = dynamics == "frozen"
    period = None if paper or solve.duration is not None else scene.period
    duration = (solve.duration or PAPER_DURATION) if paper else scene.horizon
    options = Options(
        preset=solve.preset,
        **chosen,
        reduction=_reduction(solve, dynamics),
        modes=modes_of(solve) if dynamics == "coupled" else solve.modes,
        mode_angle=solve.mode_angle,
        start=("zero" if paper else solve.start) if isinstance(solve.start, str) else "given",
        integrator=(solve.integrator if _INTEGRATOR[dynamics] != "none" else None) or _integrator(scene, dynamics),
        steps=solve.steps or default_steps(scene, duration),
        cycles=period is not None,
        duration=duration,
        rho_infinity=solve.rho_infinity,
        tolerance=tolerance_of(solve, dynamics),
        bounded=solve.bounded,
        forward_tolerance=solve.forward.tolerance,
        errors=solve.errors,
    )
    _check_options(options)
    return options


def _integrator(scene: Scene, dynamics: str) -> str:
    """Default integrator; for coupled equations without damping one without numerical damping.

    Gauss conserves the energy of a free motion over any number of swings. Radau damps vibrations that the steps do not
    resolve, as a damped mechanism does itself, and gives smooth accelerations.
    """
    damped = scene.damping is not None or any(any(spring.dampings) for spring in scene.springs.values())
    given = (body.modal for body in scene.bodies.values() if body.modal is not None)
    damped = damped or any(data.arrays["damping"].any() for data in given)
    if dynamics == "dynamic" and scene.solve.start == "periodic" and scene.period and scene.solve.duration is None:
        return "spectral"
    keeps = dynamics == "coupled" and not damped and not scene.is_spatial
    return "gauss" if keeps else _INTEGRATOR[dynamics]


def tolerance_of(solve: Solve, dynamics: str = "coupled") -> float:
    """Tolerance of the scene, or its default; 0 for dynamics without one."""
    return solve.tolerance or _TOLERANCES.get(dynamics, 0.0)


def without_poses(scene: Scene) -> Scene:
    """Scene of a fixed structure for the coupled equations: poses are replaced by angles of welds."""
    if not scene.is_frame:
        return scene
    turned = {"ground": 0.0} | {name: body.pose.angle for name, body in scene.bodies.items() if body.pose is not None}
    joints = {}
    for name, joint in scene.joints.items():
        first, second = (turned[side.body] for side in joint.addresses)
        joints[name] = joint.model_copy(update={"relative_angle": second - first})
    bodies = {name: body.model_copy(update={"pose": None}) for name, body in scene.bodies.items()}
    return scene.seen(bodies=bodies, joints=joints)


def has_term(scene: Scene, name: str) -> bool:
    """True if the scene has a group of terms: gravity, or a beam whose theory includes it."""
    if name == "gravity":
        return any(scene.gravity)
    if name in ("rotary", "shear"):
        return any(getattr(body.beam, name) for body in scene.bodies.values() if body.elastic)
    return True


def acting(scene: Scene, options: Options) -> Scene:
    """Scene without the gravity, rotary inertia and shear that the options omit, in both stages.

    A run uses the module of the original scene, in which these are ordinary parameters.
    """
    left_out = {"rotary": not options.rotary, "shear": not options.shear}
    bodies = {name: body.without(**left_out) for name, body in scene.bodies.items()}
    gravity = scene.gravity if options.gravity else (0.0, 0.0)
    if gravity == scene.gravity and all(body is scene.bodies[name] for name, body in bodies.items()):
        return scene
    return scene.seen(bodies=bodies, gravity=gravity)


def left_out(options: Options) -> tuple[str, ...]:
    """Groups of terms of the elastic links that the options do not use; all of them in a rigid mechanism.

    The spin terms need the gyroscopic matrix: in joint axes that rotate relative to the link, L^T C_d L' is part of
    them.
    """
    if options.dynamics == "rigid":
        return ("inertia", "elastic", "load", *_ELASTIC_TERMS)
    idle = tuple(name for name in _ELASTIC_TERMS if not getattr(options, name))
    return tuple(name for name in idle if name != "gyroscopic" or not options.spin)


def _reduction(solve: Solve, dynamics: str) -> str:
    """Reduction of the scene: none for rigid dynamics, else the default of the preset and of ``solve.modes``."""
    truncates = solve.modes != "all" and dynamics in ("dynamic", "quasistatic")
    default = "craig-bampton" if truncates else "modal" if dynamics == "frozen" else "none"
    return default if dynamics == "rigid" else solve.reduction or default


def default_steps(scene: Scene, duration: float) -> int:
    """Default steps: STEPS_PER_TURN a turn of the fastest drive, at least 200 in all; 2000 without a constant speed."""
    speeds = (abs(drive.speed or 0.0) for name, drive in scene.drives.items() if not scene.slides(name))
    fastest = max(speeds, default=0.0)
    turns = fastest * duration / (2 * math.pi)
    if not fastest:
        return 2000
    return max(200, math.ceil(round(STEPS_PER_TURN * turns, 6)))


def modes_of(solve: Solve) -> int:
    """Number of fixed-interface modes of each link in the coupled equations."""
    return DEFAULT_MODES if solve.modes == "all" else solve.modes


def limits_modes(solve: Solve) -> bool:
    """True if the elements of a link limit the number of its modes, as a user gives none."""
    return solve.modes == "all" or "modes" not in solve.model_fields_set


_STATELESS = {
    "rigid": "nothing deforms, so there is no initial deformation",
    "quasistatic": "preset quasistatic solves each instant separately",
    "frozen": "preset paper always starts from rest",
}
"""Reason why a kind of dynamics cannot start from a given state."""


def _check_options(options: Options) -> None:
    """Raise SceneError unless start, reduction and integrator fit each other and the kind of dynamics."""
    start, dynamics, integrator, preset = options.start, options.dynamics, options.integrator, options.preset
    exact = integrator == "exact-modal"
    if start == "given" and dynamics in _STATELESS:
        cure = "Use preset linear, stiffened or coupled with an elastic body, or solve.start = zero"
        raise SceneError("solve.start", "a table of a state", _STATELESS[dynamics], cure)
    if start == "periodic" and dynamics in ("dynamic", "coupled") and not options.cycles:
        reason = "solve.duration replaces the cycle, so there is no period"
        cure = "Give a drive a cycle and no duration, or start from zero or quasistatic"
        raise SceneError("solve.start", "periodic", reason, cure)
    if dynamics == "frozen" and options.reduction != "modal":
        reason = f"preset {preset} uses modes of the whole mechanism"
        raise SceneError("solve.reduction", options.reduction, reason, "Leave the reduction out")
    if start != "periodic" and dynamics == "dynamic" and integrator == "spectral":
        reason = f"this integrator finds periodic motions, and solve.start is {start}"
        cure = "Use radau, or start periodic, like --set solve.start=periodic"
        raise SceneError("solve.integrator", "spectral", reason, cure)
    if exact != (dynamics == "frozen") and dynamics in ("frozen", "dynamic"):
        reason = f"the equations of preset {preset} are {'coupled' if exact else 'decoupled'}"
        cure = "Use radau, generalised-alpha or newmark" if exact else "Leave the integrator out"
        raise SceneError("solve.integrator", integrator, reason, cure)
