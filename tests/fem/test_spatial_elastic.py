"""Elastic links in space: the plane seen otherwise, rotors and blades in closed form, frames, what is refused."""

import copy
import math
from functools import cache

import numpy as np
import pytest
from lifting import TURN, lifted
from machines import machine
from runs import shipped, solved
from scipy.linalg import eig
from sympy import Matrix, Symbol, sqrt
from test_spatial_links import swept

from kaneflex import SceneError, load, read_scene, scene_of, with_settings
from kaneflex.fem.spatial_bodies import rigid_part
from kaneflex.fem.spatial_joined import direction_of
from kaneflex.generated import spatial
from kaneflex.mechanism.affine import as_array
from kaneflex.mechanism.mechanism import mechanism_of
from kaneflex.mechanism.spatial import SpatialBody
from kaneflex.mechanism.spatial_frame import at_point
from kaneflex.multibody.model.assembly import rigid_system
from kaneflex.multibody.model.bound_model import keep_terms
from kaneflex.multibody.model.initial_state import start_of
from kaneflex.multibody.model.module_loading import bind_parameters, find_laws_module
from kaneflex.multibody.model.tree_layout import COORDINATE, SPEED
from kaneflex.plots.sensors import grouped

STEEL = 'E = "200 GPa", nu = 0.3, rho = "7850 kg/m^3"'


def matrices(model, t=0.0):
    """M, C, K and F of the kept terms at an instant, as arrays."""
    rigid = model.motion.at(t)
    kept = keep_terms(model.equations, model.options)
    return {key: as_array(rigid.first(kept[key])) for key in "MCKF"}


def frequencies(M, C, K):
    """[rad/s] of M q'' + C q' + K q = 0, which neither grows nor falls."""
    none, one = np.zeros_like(M), np.eye(len(M))
    roots = eig(np.block([[none, one], [-np.linalg.solve(M, K), -np.linalg.solve(M, C)]]), right=False)
    return np.sort(roots.imag[roots.imag > 0])


# ---- the plane, seen otherwise ----------------------------------------------------------------------------------


def test_a_slow_start_asks_for_no_reactions_that_rigid_bodies_share():
    """Redundant constraints hold a planar linkage in space: what they share is no number, and in no equation.

    How slow a motion can be depends on its coordinates, of joints in the plane and of links in space, by 0.3 %.
    """
    scene = with_settings(read_scene("four-bar"), ["coupler.elements=2", "follower.elements=2"])
    solve = {"preset": "linear", "start": "quasistatic", "duration": 0.001, "steps": 10}
    planar = scene_of({**scene.raw, "solve": solve})
    given = lifted(planar) | {"solve": solve}
    flat, deep = solved(planar), solved(scene_of(given))
    assert deep.model.module.open_reactions
    for sensor in ("coupler_mid", "follower_mid", "crank_tip"):
        assert deep[sensor].values == pytest.approx(flat[sensor].values, rel=5e-3), sensor


def test_a_plane_in_space_moves_as_many_coordinates_as_the_plane():
    """Out-of-plane bending and twist stay at rest, unless gravity has a component across the plane."""
    for name in ("four-bar", "slider-crank-150"):
        planar = read_scene(name)
        given = lifted(planar) | {"solve": planar.raw["solve"]}
        across = given | {"gravity": [float(x) for x in TURN @ [0.0, 1.0, 1e-9]]}
        systems = [load(scene).system for scene in (planar, scene_of(given), scene_of(across))]
        flat, deep, heavy = (each.reached(*np.zeros((2, each.n))).sum() for each in systems)
        assert flat == deep == systems[0].n < heavy <= systems[1].n


CARRIED = machine(
    gravity=[3.0, -9.0],
    bodies=dict(arm='length = 0.5, '
                    'beam = {material = "aluminium", section = {rectangle = [0.004, 0.02]}, elements = 3}',
                plate="length = 0.1, mass = 0.2, inertia = 3e-4, centre = [0.04, 0.01], points = {q = [0.05, 0.03]}"),
    joints=dict(root="revolute ground arm.start", tip="weld arm.end plate.start"),
    drives=dict(root='law = "0.7*sin(6*t)"'),
    loads=dict(push='force_on = "plate.q", axes = "body", direction = [0.3, 1], law = "2*sin(20*t)"'),
    sensors=dict(speed_x="velocity plate.q", speed_y="velocity plate.q y", felt_x="acceleration plate.start",
                 felt_y="acceleration plate.start y", force_x='joint_force tip, axes = "body"',
                 force_y='joint_force tip, axes = "body", component = "y"'),
    solve="duration = 0.4",
)


@pytest.mark.parametrize("preset", ["quasistatic", "linear"])
def test_a_rigid_body_on_an_elastic_one_turns_with_it_for_sensors_in_its_axes(preset):
    """By up to 0.3 rad. The quasi-static answer leaves out rates of coordinates, which are others in the plane."""
    solve = {"preset": preset, "duration": 0.4, "steps": 800}
    planar = scene_of(CARRIED)
    given = lifted(planar) | {"solve": solve}
    flat, deep = solved(scene_of({**planar.raw, "solve": solve})), solved(scene_of(given))
    for sensor in given["sensors"]:
        wanted, found = flat[sensor].values[80:], deep[sensor].values[80:]
        assert abs(found - wanted).max() < (0.03 if preset == "quasistatic" else 1e-4) * abs(wanted).max(), sensor


# ---- frames at rest ---------------------------------------------------------------------------------------------

BENT = f"""
schema = 1
gravity = [0, 0, 0]
bodies.arm = {{length = "1 m", beam = {{{STEEL}, section = {{circle = "20 mm"}}, elements = 3}}}}
bodies.leg.length = "0.6 m"
bodies.leg.rotation = {{x = [0, 1, 0]}}
bodies.leg.beam = {{{STEEL}, section = {{circle = "20 mm"}}, elements = 2}}
joints.root = {{revolute = ["ground", "arm.start"], axis = [0, 0, 1]}}
joints.corner = {{weld = ["arm.end", "leg.start"]}}
drives.root = {{speed = "0 rpm"}}
loads.push = {{force_on = "leg.end", direction = [0, 0, 1], value = "10 N"}}
sensors.tip = {{displacement = "leg.end", component = "z", axes = "global"}}
sensors.torque = {{torsional_moment = "arm.mid"}}
sensors.bending = {{bending_moment = "arm.start", component = "y"}}
sensors.shear = {{shear_force = "arm.mid", component = "z"}}
sensors.gauge = {{strain = "arm.start", fibre = ["3 mm", "8 mm"]}}
sensors.root_force = {{joint_force = "root", component = "z"}}
sensors.root_moment = {{joint_force = "root", component = "angle_y"}}
sensors.corner_moment = {{joint_force = "corner", component = "angle_x"}}
solve = {{preset = "quasistatic", duration = "1 s", steps = 4}}
"""


def test_a_bent_frame_bends_and_twists():
    """Tip of a cantilever with a leg across it, by Castigliano: P (l^3 + h^3)/(3 E I) + P h^2 l/(G J); its balance."""
    text = BENT
    solution = solved(scene_of(text))
    E, G, d, long, h, P = 200e9, 200e9 / 2.6, 0.02, 1.0, 0.6, 10.0
    EI, GJ = E * math.pi * d**4 / 64, G * math.pi * d**4 / 32
    wanted = {
        "tip": P * (long**3 + h**3) / (3 * EI) + P * h**2 * long / GJ, "torque": P * h, "bending": P * long,
        "shear": P, "gauge": -0.008 * P * long / EI, "root_force": -P, "root_moment": P * long, "corner_moment": -P * h,
    }  # fmt: skip
    signs = {"bending": -1.0}  # M_y = -E I_y w''
    for sensor, value in wanted.items():
        assert solution[sensor].values == pytest.approx(signs.get(sensor, 1.0) * value, rel=1e-9), sensor


def test_moments_between_nodes_under_weight():
    """A cantilever's E I v'' = q (l - x)^2/2 in both planes, where no node is: the weight's share within elements."""
    text = BENT.replace("gravity = [0, 0, 0]", "gravity = [0, -3, -9.81]")
    text = text[: text.index("bodies.leg")] + text[text.index("joints.root") : text.index("joints.corner")] + """
drives.root = {speed = "0 rpm"}
solve = {preset = "quasistatic", duration = "1 s", steps = 4}
"""
    motion = solved(scene_of(text)).motion
    q = 7850 * math.pi * 0.02**2 / 4
    for x in (0.05, 0.21, 0.62, 0.95):
        _, V_y, V_z, _, M_y, M_z = (part[0] for part in motion.section("arm", x))
        rest = 1.0 - x
        assert M_z == pytest.approx(-3 * q * rest**2 / 2, rel=1e-9)
        assert M_y == pytest.approx(9.81 * q * rest**2 / 2, rel=1e-9)
        assert (V_y, V_z) == pytest.approx((-3 * q * rest, -9.81 * q * rest), rel=1e-9)


# ---- rotors -----------------------------------------------------------------------------------------------------

ROTOR = """
schema = 1
gravity = [0, 0, 0]
bodies.shaft.length = "0.5 m"
bodies.shaft.beam = {E = "200 GPa", nu = 0.3, rho = "0.01 kg/m^3", section = {circle = "20 mm"}, elements = 2}
bodies.disc = {mass = "5 kg", inertia = ["0.09 kg m^2", "0.05 kg m^2", "0.05 kg m^2"]}
joints.bearing = {revolute = ["ground", "shaft.start"], axis = [1, 0, 0]}
joints.hub = {weld = ["shaft.end", "disc.start"]}
drives.bearing = {speed = "SPEED rad/s", cycle = "360 deg"}
solve.preset = "stiffened"
"""


@pytest.mark.parametrize("speed", [50.0, 400.0])
def test_a_disc_on_an_overhung_shaft_whirls(speed):
    """Forward and backward whirl of a rigid disc on a massless cantilever shaft, seen from the turning shaft.

    K = E I [[12/l^3, -6/l^2], [-6/l^2, 4/l]] before deflection and slope, gyroscopic moment J_x speed (Genta,
    Dynamics of Rotating Systems, 2005, ch. 2): a frequency p of the inertial frame is |p - speed| here; torsion
    sqrt(G J/(l J_x)) turns with it.
    """
    model = load(scene_of(ROTOR.replace("SPEED", repr(speed))))
    found = frequencies(*(matrices(model)[key] for key in "MCK"))
    long, EI, m, J_x, J_y = 0.5, 200e9 * math.pi * 0.02**4 / 64, 5.0, 0.09, 0.05
    K = EI * np.array([[12 / long**3, -6 / long**2], [-6 / long**2, 4 / long]])
    M, G = np.diag([m, J_y]), np.diag([0.0, J_x * speed])
    none, one = np.zeros((2, 2)), np.eye(2)
    whirls = eig(np.block([[none, one], [np.linalg.solve(M, K), np.linalg.solve(M, G)]]), right=False).real
    torsion = math.sqrt(200e9 / 2.6 * math.pi * 0.02**4 / 32 / (long * J_x))
    axial = math.sqrt(200e9 * math.pi * 0.02**2 / 4 / (long * m))
    for wanted in (*abs(whirls - speed), torsion, axial):
        assert abs(found / wanted - 1).min() < 2e-6, (wanted, found[:10])


def test_a_rigid_body_is_the_same_from_any_of_its_points():
    """Its matrices of the small motion, the start moved by p: M and the gyroscopic terms are congruent, and its load is
    what Newton and Euler ask for."""
    rng = np.random.default_rng(3)
    a = rng.normal(size=(3, 3))
    tensor = a @ a.T
    inertia = 0.5 * (np.trace(tensor) * np.eye(3) - tensor) * 2  # of a body that has those second moments
    six = np.array([*np.diag(inertia), inertia[0, 1], inertia[1, 2], inertia[2, 0]])
    p, c = rng.normal(size=3), rng.normal(size=3)
    here, there = (rigid_part("b", SpatialBody(2.0, centre, six, np.eye(3))).matrices for centre in (c, c - p))
    w, e, f = rng.normal(size=3), rng.normal(size=3), rng.normal(size=3)
    moved = f + np.cross(e, p) + np.cross(w, np.cross(w, p))

    def scalars(acceleration):
        named = {"omega": w, "epsilon": e, "a": acceleration}
        found = {f"b.link.{kind}_{axis}": v for kind, vs in named.items() for axis, v in zip("xyz", vs, strict=True)}
        return found | {f"b.link.arms_{pair}": 0.0 for pair in ("xx", "xy", "xz", "yy", "yz", "zz")}

    shift = at_point(p)
    for key in ("M", "C_d"):
        mine, other = here[key].value(scalars(f)), there[key].value(scalars(moved))
        assert mine == pytest.approx(shift.T @ other @ shift, abs=1e-12)
    assert here["F"].value(scalars(f)) == pytest.approx(shift.T @ there["F"].value(scalars(moved)), abs=1e-12)
    asked = np.zeros(6)
    spatial.demand(np.array([2.0, *c, *six]), 0, np.concatenate([w, f, e]), 0, asked, 0)
    assert here["F"].value(scalars(f))[:, 0] == pytest.approx(-asked, abs=1e-12)


# ---- blades -----------------------------------------------------------------------------------------------------


@cache
def swept_scene(degrees, rpm):
    raw = copy.deepcopy(read_scene("swept-blade").raw)
    raw["bodies"]["tip"]["rotation"]["angle"] = f"-{degrees} deg"
    raw["drives"]["shaft"]["speed"] = f"{rpm} rpm"
    del raw["damping"]
    return raw


@pytest.mark.parametrize(("degrees", "rpm"), [(0, 500), (15, 750)])
def test_the_swept_blade_has_the_frequencies_of_its_links(degrees, rpm):
    """As welded by hand of two links (``test_spatial_links``, beside the experiment there)."""
    model = load(scene_of(swept_scene(degrees, rpm)))
    found = frequencies(*(matrices(model)[key] for key in "MCK")) / (2 * math.pi)
    assert found[:9] == pytest.approx(swept(float(degrees), rpm)[:9], rel=1e-5)


# ---- what joints exert ------------------------------------------------------------------------------------------


@pytest.mark.exhaustive(share=2)
@pytest.mark.parametrize("name", ["spatial-slider-crank-elastic", "four-bar-misaligned", "crankshaft-torsion",
                                  "robot-arm-elastic"])
def test_elastic_bodies_are_in_balance(name):
    """Of ten thousand times the stiffness, forces and moments of joints and drives are those of the rigid mechanism, by
    the engine of that."""
    scene = read_scene(name)
    stiff = {
        key: body if body.beam is None else body.model_copy(
            update={"beam": body.beam.model_copy(update={"E": 1e4 * body.beam.E, "G": 1e4 * made_of.G})}
        )
        for key, body in scene.bodies.items() for made_of in [None if body.beam is None else body.beam.constants()]
    }  # fmt: skip
    solve = scene.solve.model_copy(update={"preset": "quasistatic", "start": "zero", "steps": 90})
    solution = solved(scene.seen(bodies=stiff, solve=solve, damping=None))
    motion = solution.motion
    rigid = motion.rigid
    lost = solution.model.module.open_reactions
    largest = max(abs(rigid[f"{each}.force_{axis}"]).max() for each in scene.joints for axis in "xyz"
                  if f"{each}.force_{axis}" not in lost)  # fmt: skip
    for joint in scene.joints:
        for part in ("force", "moment"):
            names = [f"{joint}.{part}_{axis}" for axis in "xyz"]
            if lost & set(names):
                continue
            wanted = np.array([rigid[each] for each in names])
            found = np.array([motion.reaction(each) for each in names])
            assert abs(found - wanted).max() < 2e-4 * (largest if part == "force" else 0.1 * largest), (joint, part)
    for drive in scene.drives:
        wanted = rigid[f"{drive}.drive"]
        assert abs(motion.reaction(f"{drive}.drive") - wanted).max() < 2e-4 * abs(wanted).max()


ELASTIC = [
    name for name, scene in shipped().items()
    if scene.is_spatial and any(body.elastic for body in scene.bodies.values())
]  # fmt: skip


@cache
def few_steps(name, preset):
    scene = with_settings(read_scene(name), [f"solve.preset={preset}", "solve.start=zero", "solve.steps=12"])
    return solved(scene)


@pytest.mark.exhaustive(share=6)
@pytest.mark.parametrize("preset", ["quasistatic", "linear", "stiffened"])
@pytest.mark.parametrize("name", ELASTIC)
def test_no_joint_opens(name, preset):
    """Points that joints hold together stay so to rounding, though the deformation is of any size, and move alike."""
    if name == "crankshaft-torsion" and preset == "stiffened":
        pytest.skip("forces at its journals are statically indeterminate")
    motion = few_steps(name, preset).motion
    mechanism = mechanism_of(motion.model.scene)
    for joint in mechanism.joints.values():
        moved = []
        for side in joint.sides:
            frame, at = motion.rigid.frame(side.body), np.reshape(side.at, (3, 1))
            zero = np.zeros((3, len(motion.times)))
            d, rate, accel = (zero,) * 3 if side.body == "ground" else (
                part[:3] for part in motion.displacement(side.body, side.at)
            )  # fmt: skip
            moved.append((frame.place(at + d), frame.velocity(at + d, rate), frame.acceleration(at + d, rate, accel)))
        for first, second in zip(*moved, strict=True):
            gap = second - first
            if joint.across is not None:
                if joint.sides[0].body != "ground":
                    continue  # its guide turns with the deformation
                gap = np.array(joint.across) @ gap
            assert abs(gap).max() <= 1e-6 * max(abs(second).max(), 1e-3 * abs(first).max(), 1e-9), joint.name


@pytest.mark.exhaustive(share=6)
@pytest.mark.parametrize("preset", ["rigid", "quasistatic", "linear", "stiffened"])
@pytest.mark.parametrize("name", ELASTIC)
def test_section_forces_at_an_end_are_what_the_joint_there_exerts(name, preset):
    """All six, of links at whose start or end one joint alone acts, and no load."""
    if name == "crankshaft-torsion" and preset in ("stiffened", "rigid"):
        pytest.skip("forces at its journals are statically indeterminate")
    motion = few_steps(name, preset).motion
    mechanism, lost = mechanism_of(motion.model.scene), motion.model.module.open_reactions
    found = 0
    for link, body in motion.model.scene.bodies.items():
        for end, x in (("start", 0.0), ("end", body.length)) if body.elastic else ():
            here = [(joint, k) for joint in mechanism.joints.values() for k, side in enumerate(joint.sides)
                    if side.body == link and side.at[0] == x]  # fmt: skip
            loaded = any(load.point is not None and (load.point.body, load.point.at[0]) == (link, x)
                         for load in mechanism.loads.values())  # fmt: skip
            if len(here) != 1 or loaded or (preset == "rigid" and lost):
                continue
            (joint, side), frame = here[0], motion.rigid.frame(link)
            exerted = np.array([motion.reaction(f"{joint.name}.{part}_{axis}")
                                for part in ("force", "moment") for axis in "xyz"])  # fmt: skip
            sign = (1.0 if side == 1 else -1.0) * (1.0 if end == "end" else -1.0)
            wanted = sign * np.vstack([frame.to_body(exerted[:3]), frame.to_body(exerted[3:])])
            section = np.array(motion.section(link, x))
            largest = max(abs(wanted[:3]).max(), abs(wanted[3:]).max() / body.length) or 1.0
            assert abs(section[:3] - wanted[:3]).max() < 1e-6 * largest, (joint.name, end)
            turning = max(largest * body.length, abs(wanted[3:]).max())  # one that only twists is pushed by rounding
            assert abs(section[3:] - wanted[3:]).max() < 1e-6 * turning, (joint.name, end)
            found += 1
    assert found or preset == "rigid" or name == "crankshaft-torsion"


# ---- what is refused --------------------------------------------------------------------------------------------


@pytest.mark.parametrize(("old", "new", "said"), [
    ('section = {circle = "20 mm"}, elements = 3', 'A = "100 mm^2", I = "800 mm^4"',
     r"bodies.arm.beam.I = .*bends about two axes and twists.*I_y, I_z and J"),
    ('section = {circle = "20 mm"}, elements = 3', 'A = "100 mm^2", I_y = "800 mm^4", I_z = "800 mm^4"',
     r"bodies.arm.beam.J.*missing"),
    ("nu = 0.3, ", "", r"bodies.(arm|leg).beam.*needs a shear modulus"),
    ("elements = 3", "axially_rigid = true", r"axially_rigid.*only planar beams"),
    ('component = "y"}\nsensors.shear', "component = \"x\"}\nsensors.shear",
     r"sensors.bending.component = 'x'.*its y or z"),
    ('preset = "quasistatic"', 'preset = "paper"', r"solve.preset = 'paper': only planar scenes"),
    ('"leg.end", direction', '"leg.tip", direction', r"loads.push.force_on"),
])  # fmt: skip
def test_what_elastic_bodies_cannot_have_in_space_is_named(old, new, said):
    text = BENT
    assert old in text
    with pytest.raises(SceneError, match=said):
        load(scene_of(text.replace(old, new, 1)))


def test_a_joint_beside_the_axis_of_a_link_is_named():
    text = BENT.replace('arm = {length = "1 m"', 'arm = {length = "1 m", points = {side = ["1 m", "10 mm", 0]}')
    text = text.replace('["arm.end", "leg', '["arm.side", "leg')
    with pytest.raises(SceneError, match="a joint on an elastic body must lie on its axis"):
        load(scene_of(text))


def test_stiffness_by_forces_that_rigid_bodies_share_anyhow_is_named():
    """A shaft that two bearings hold along it: what pulls at it no rigid body says; without that stiffness it runs."""
    text = ROTOR.replace("SPEED", "50.0") + 'ground.far = ["0.5 m", 0, 0]\n'
    text += 'joints.second = {revolute = ["ground.far", "shaft.end"], axis = [1, 0, 0]}'
    with pytest.raises(SceneError, match=r"bodies.shaft: constraints are redundant.*Use preset linear"):
        load(scene_of(text))
    assert load(scene_of(text.replace("stiffened", "linear"))).degrees_of_freedom == 7


@pytest.mark.parametrize("name", ["rotating-blade", "robot-arm-elastic"])
def test_sensors_share_a_panel_with_those_of_their_unit(name):
    scene = read_scene(name)
    for title, names in grouped(scene, scene.sensors).items():
        assert len({scene.sensors[each].unit for each in names}) == 1, title


HINGED = machine(
    gravity=["1 m/s^2", "-2 m/s^2", "-9.81 m/s^2"],
    springs=dict(s='torsional_at = "hinge", stiffness = "900 N m/rad", angle = 0'),
    bodies=dict(hub='length = "0.3 m", mass = "1 kg", rotation = {x = [1, 0, 0]}, points.far = ["1.3 m", 0, 0]',
                top='mass = "2 kg", centre = ["0.2 m", "0.05 m", "-0.08 m"], '
                    'inertia = [0.03, 0.05, 0.04, 0.004, -0.003, 0.002]'),
    joints=dict(shaft="revolute ground hub.start, axis = [0.6, 0, 0.8]",
                hinge="revolute CARRIER top.start, axis = [0.48, -0.6, 0.64]"),
    drives=dict(shaft='law = "2 * sin(3 * t)"'), solve='duration = "1 s"',
)


@pytest.mark.parametrize("t", [0.0, 0.37, 0.8])
def test_a_rigid_body_on_a_hinge_has_the_stiffness_that_its_nonlinear_equations_have(t):
    """Its small rotation about a skew axis, all forces at their arms included, held by a spring
    on a hub that turns unevenly: its acceleration by the engine of rigid mechanisms, by finite differences."""
    stiff = 'beam = {E = "2e5 GPa", nu = 0.3, rho = "1e-6 kg/m^3", section = {circle = "0.3 m"}, elements = 1}'
    elastic = HINGED.replace("CARRIER", "stub.end") + """
joints.root = {weld = ["hub.end", "stub.start"]}
drives.hinge = {law = "0", rotation = "free"}
solve.preset = "stiffened"
solve.start = "zero"
"""
    rigid = HINGED.replace("CARRIER", "hub.far") + """
drives.hinge.free = true
solve.preset = "rigid"
"""
    found = matrices(load(scene_of(f'{elastic}[bodies.stub]\nlength = "1 m"\nrotation.x = [1, 0, 0]\n{stiff}')), t)
    lowest = eig(found["K"], found["M"], right=False).real.min()
    free = scene_of(rigid)
    module, _ = find_laws_module(free, lambda stage: None)
    system = rigid_system(mechanism_of(free), module, bind_parameters(free, module))
    start = start_of(system)
    at, speed = (int(system.columns(["hinge"], what)[0]) for what in (COORDINATE, SPEED))
    rates = []
    for step in (1e-4, -1e-4):
        q = start.q.copy()
        q[at] = step
        rates.append(system.project(t, q, np.zeros(system.engine.size), start.choice).du[speed])
    assert lowest == pytest.approx(-(rates[0] - rates[1]) / 2e-4, rel=1e-6)


def test_rates_of_a_direction_are_its_derivatives():
    t = Symbol("t")
    d = Matrix([1 + 2 * t**2, t - 3 * t**3, 2 - t])
    e = d / sqrt(d.dot(d))
    given, expected = ([np.array(of.diff(t, k).subs(t, 0.4), dtype=float).T for k in range(3)] for of in (d, e))
    assert direction_of(np.array(given)) == pytest.approx(np.array(expected), abs=1e-13)
