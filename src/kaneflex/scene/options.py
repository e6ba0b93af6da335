"""Named models: what each preset keeps of the equations, and every option of a run spelled out."""

from __future__ import annotations

import math
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

from kaneflex.scene import Scene
from kaneflex.scene.option_check import check_contacts, check_coupled, check_laws, check_options
from kaneflex.scene.start import Start
from kaneflex.support.errors import SceneError

DEFAULT_MODES = 3
"""Fixed-interface modes of a link in the coupled equations, where the scene asks for no number of its own."""
STEPS_PER_TURN = 720
"""Default resolution: half a degree of the fastest drive."""
PAPER_DURATION = 0.04
"""The paper's horizon [s], Figs. 18-28: four turns at 6000 rpm."""


@dataclass(frozen=True)
class Options:
    """Everything that distinguishes one run of a scene from another.

    Attributes
    ----------
    preset : str
        Where the defaults came from.
    dynamics : str
        "rigid" (no deformation), "quasistatic" (K z = F at each instant), "frozen" (constant coefficients, decoupled,
        paper (143)) or "dynamic" (time-varying coefficients).
    spin, gyroscopic, euler, geometric, damping : bool
        Complete term groups: proportional to omega^2, omega, epsilon, the axial force, and the material damping.
    rotary, shear, gravity : bool
        Groups that a scene has or has not: rotary inertia of the sections, their shear, gravity; in both stages.
    convective : bool
        Keep T' and T'' of the joint displacements' transformation.
    weld_pins, free_drives : bool
        Share the elastic rotation at pins between elastic links; leave it free at the drives.
    elements : int or None
        Elements of every link; None leaves each link its own number.
    foreshortening : bool
        Displacements include the shortening of the bent axis, -1/2 int v'^2 dx.
    reduction : str
        "none", "craig-bampton" (each link, in its own axes) or "modal" (modes of the whole mechanism at mode_angle).
    modes : int or "all"
        Modes kept: of each link, or of the mechanism.
    mode_angle : float
        Angle of the first drive at which reference modes are taken and the frozen model is frozen [rad].
    start : str
        "zero", "quasistatic", "periodic", or "given" where the scene gives a state.
    integrator : str
        Name in ``kaneflex.integrate.methods.METHODS``.
    steps : int
        Per cycle, or per run where there is no cycle.
    cycles : bool
        Whether ``steps`` counts a cycle.
    duration : float
        Horizon of the run [s].
    rho_infinity : float
        Spectral radius of generalised-alpha at infinite frequency.
    tolerance : float
        Of the coupled equations: error that ten periods of a vibration accumulate, as a share of the longest body, and
        in rad. Of the integrator spectral: error of the motion as a share of it, in the energy norm.
    bounded : tuple of str
        What else it bounds at every step, as a share of its largest value so far: "speeds", "reactions".
    forward_method : str
        Method of scipy's ``solve_ivp`` for free joints that are integrated before anything deforms.
    forward_tolerance : float
        Its relative tolerance.
    errors : str
        Which errors of the sensors are estimated: "quick" (what takes no several times of a long run), "all" or "none".
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
    forward_method: str
    forward_tolerance: float
    errors: str

    def as_dict(self) -> dict[str, object]:
        """By name, as a file holds them."""
        return {name: list(value) if isinstance(value, tuple) else value for name, value in asdict(self).items()}


_ALL = dict.fromkeys(
    ("spin", "gyroscopic", "euler", "geometric", "damping", "convective", "rotary", "shear", "gravity"), True
)
_ELASTIC_TERMS = ("spin", "gyroscopic", "euler", "geometric", "damping")
_RIGID = {"rotary": True, "gravity": True}  # the groups that the rigid mechanism knows, too
_PRESETS: dict[str, dict[str, Any]] = {
    "rigid": dict.fromkeys(_ALL, False) | _RIGID | {"dynamics": "rigid", "foreshortening": False},
    # Without any damping: C_s L' would act like a force that no structure knows.
    "quasistatic": _ALL | {"gyroscopic": False, "damping": False, "dynamics": "quasistatic", "foreshortening": True},
    "paper": _ALL
    | {"gyroscopic": False, "geometric": False, "damping": False, "convective": False, "dynamics": "frozen"}
    | {"foreshortening": False, "weld_pins": True, "free_drives": True, "elements": 1},
    "linear": _ALL | {"geometric": False, "dynamics": "dynamic", "foreshortening": False},
    "stiffened": _ALL | {"dynamics": "dynamic", "foreshortening": True},
    # Its displacements are those of the bent axis as it is: the foreshortening is in the equations.
    "coupled": _ALL | {"dynamics": "coupled", "foreshortening": False},
}
UNUSED_TERMS = {
    "rigid": tuple(name for name in _ALL if name not in _RIGID),
    "quasistatic": ("gyroscopic", "damping"),
    "frozen": ("gyroscopic",),
    "dynamic": (),
    "coupled": (),
}
"""Term groups that each kind of dynamics has no place for: they stay out, whatever a scene says."""
_INTEGRATOR = {"rigid": "none", "quasistatic": "none", "frozen": "exact-modal", "dynamic": "radau", "coupled": "radau"}
_TOLERANCES = {"coupled": 1e-8, "dynamic": 1e-6}
_REDUCTION = {"rigid": "none", "quasistatic": "none", "frozen": "modal", "dynamic": "none", "coupled": "none"}


def resolve_options(scene: Scene) -> Options:
    """The preset of the scene with the scene's own settings on top.

    Raises
    ------
    SceneError
        Where settings contradict each other; it names both.
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
            f"preset {solve.preset} takes a link's elements, which modal data don't have",
            "Take preset coupled or rigid, or give the body a beam",
        )  # fmt: skip
    elastic = modal is not None or any(body.elastic for body in scene.bodies.values())
    if elastic and scene.is_frame and solve.preset == "rigid":
        raise SceneError(
            "solve.preset", "rigid",
            "a structure that stands still has no rigid motion, and its supports may be redundant",
            "Take preset quasistatic, linear or stiffened",
        )  # fmt: skip
    if not elastic and (dynamics != "coupled" or scene.is_frame):
        dynamics, chosen["dynamics"] = "rigid", "rigid"
    if dynamics == "coupled":
        check_coupled(scene)
    if not scene.is_spatial:  # whose bodies move freely, and whose laws know any joint, without the coupled equations
        check_contacts(scene, dynamics)
        check_laws(scene, dynamics)
    paper = dynamics == "frozen"
    period = None if paper or solve.duration is not None else scene.period
    duration = (solve.duration or PAPER_DURATION) if paper else scene.horizon
    options = Options(
        preset=solve.preset,
        **chosen,
        reduction=_reduction(scene, dynamics),
        modes=modes_of(scene) if dynamics == "coupled" else solve.modes,
        mode_angle=solve.mode_angle,
        start="given" if isinstance(solve.start, Start) else "zero" if paper else solve.start,
        integrator=(solve.integrator if _INTEGRATOR[dynamics] != "none" else None) or _integrator(scene, dynamics),
        steps=solve.steps or default_steps(scene, duration),
        cycles=period is not None,
        duration=duration,
        rho_infinity=solve.rho_infinity,
        tolerance=tolerance_of(scene, dynamics),
        bounded=solve.bounded,
        forward_method=solve.forward.method,
        forward_tolerance=solve.forward.tolerance,
        errors=solve.errors,
    )
    check_options(options)
    return options


def _integrator(scene: Scene, dynamics: str) -> str:
    """What integrates where a scene leaves it open: of coupled equations, what damps nothing where nothing is damped.

    Gauss keeps the energy of a free motion over any number of swings; Radau lets what no step resolves die away, which
    a damped mechanism's own vibrations do, too, and leaves its accelerations clean.
    """
    damped = scene.damping is not None or any(any(spring.dampings) for spring in scene.springs.values())
    given = (body.modal for body in scene.bodies.values() if body.modal is not None)
    damped = damped or any(data.arrays["damping"].any() for data in given)
    if dynamics == "dynamic" and scene.solve.start == "periodic" and scene.period and scene.solve.duration is None:
        return "spectral"
    keeps = dynamics == "coupled" and not damped and not scene.is_spatial
    return "gauss" if keeps else _INTEGRATOR[dynamics]


def tolerance_of(scene: Scene, dynamics: str = "coupled") -> float:
    """The scene's, or what it has where it gives none; 0 of dynamics that know none."""
    return scene.solve.tolerance or _TOLERANCES.get(dynamics, 0.0)


def moves_with_links(scene: Scene, dynamics: str) -> bool:
    """Whether the coupled equations move free joints, by ``solve.tolerance``; else scipy does, by ``solve.forward``."""
    return dynamics == "coupled" and (not scene.is_spatial or any(body.deforms for body in scene.bodies.values()))


def without_poses(scene: Scene) -> Scene:
    """A structure in given poses as the coupled equations place it: by welds that turn its bodies so."""
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
    """Whether the scene has what a group of terms is about: gravity, or a beam whose theory knows it."""
    if name == "gravity":
        return any(scene.gravity)
    if name in ("rotary", "shear"):
        return any(getattr(body.beam, name) for body in scene.bodies.values() if body.elastic)
    return True


def acting(scene: Scene, options: Options) -> Scene:
    """The scene without the gravity, rotary inertia and shear that the options leave out, in both stages.

    A run takes the module of the scene as it is written, in which they are numbers like others.
    """
    left_out = {"rotary": not options.rotary, "shear": not options.shear}
    bodies = {name: body.without(**left_out) for name, body in scene.bodies.items()}
    gravity = scene.gravity if options.gravity else (0.0, 0.0)
    if gravity == scene.gravity and all(body is scene.bodies[name] for name, body in bodies.items()):
        return scene
    return scene.seen(bodies=bodies, gravity=gravity)


def left_out(options: Options) -> tuple[str, ...]:
    """Groups of terms of the elastic links that have no use under the options; all of them in a rigid mechanism.

    The gyroscopic matrix stays with the spin terms: in joint axes that turn against the link, L^T C_d L' is of them.
    """
    if options.dynamics == "rigid":
        return ("inertia", "elastic", "load", *_ELASTIC_TERMS)
    idle = tuple(name for name in _ELASTIC_TERMS if not getattr(options, name))
    return tuple(name for name in idle if name != "gyroscopic" or not options.spin)


def _reduction(scene: Scene, dynamics: str) -> str:
    """The scene's reduction, none where nothing deforms, or the default of the preset and of ``solve.modes``."""
    truncates = scene.solve.modes != "all" and dynamics in ("dynamic", "quasistatic")
    default = "craig-bampton" if truncates else _REDUCTION[dynamics]
    return default if dynamics == "rigid" else scene.solve.reduction or default


def default_steps(scene: Scene, duration: float) -> int:
    """STEPS_PER_TURN for each turn of the fastest drive, at least 200 in all; 2000 where no drive turns at a speed."""
    speeds = (abs(drive.speed or 0.0) for name, drive in scene.drives.items() if not scene.slides(name))
    fastest = max(speeds, default=0.0)
    turns = fastest * duration / (2 * math.pi)
    if not fastest:
        return 2000
    return max(200, math.ceil(round(STEPS_PER_TURN * turns, 6)))


def modes_of(scene: Scene) -> int:
    """Fixed-interface modes of each link in the coupled equations."""
    return DEFAULT_MODES if scene.solve.modes == "all" else scene.solve.modes
