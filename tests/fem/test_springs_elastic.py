"""Springs on elastic bodies: frequencies and deflections in closed form, and the coupled equations beside them."""

import math

import numpy as np
import pytest
from machines import changed, machine, pendulum
from runs import STENCIL, alike, waving
from scipy.optimize import brentq

import kaneflex
from kaneflex import Scene, SceneError, scene_of, with_settings
from kaneflex.solve.simulation import solve

L, E, I, A, RHO = 0.8, 2.1e11, 4e-10, 6e-5, 7850.0
BEAM = f"length = {L}, beam = {{E = {E}, rho = {RHO}, A = {A}, I = {I}, elements = 8}}"
EI, MASS = E * I, RHO * A


def written(text, *settings) -> Scene:
    return with_settings(scene_of(text), list(settings))


def loaded(text, *settings):
    return kaneflex.load(written(text, *settings))


def frequencies(model) -> np.ndarray:
    """Angular frequencies of the undamped linear equations at t = 0 [rad/s]."""
    system = kaneflex.linearise(model)
    return np.sqrt(np.sort(np.linalg.eigvals(np.linalg.solve(system.M, system.K)).real))


# A cantilever on a hub that is held, so that there is a rigid motion with reactions; or a frame that stands.
HELD = pendulum(BEAM, "speed = 0", hinge="root", ground=dict(below=[L, -0.3]), solve=dict(duration=1.0))
STANDING = machine(
    ground=dict(below=[L, -0.3]), bodies=dict(bar=f"pose = {{}}, {BEAM}"), joints=dict(root="JOINT ground bar.start"),
    sensors=dict(tip="displacement bar.end y"), solve=dict(duration=1.0),
)
WELDED = STANDING.replace("JOINT", "weld")


def scene_text(base, spring):
    return f"{base}springs.{spring}\n"


@pytest.mark.parametrize("base", [HELD, WELDED], ids=["held", "standing"])
@pytest.mark.parametrize("stiffness", [50.0, 3e3])
def test_a_cantilever_with_a_spring_at_its_tip(base, stiffness):
    """(1 + cos cosh) b^3 + kL^3/EI (cosh sin - sinh cos) = 0 (Blevins 1979, ch. 8); no tension at its free length."""
    spring = f'tip = {{between = ["ground.below", "bar.end"], stiffness = {stiffness}, length = 0.3}}'
    ratio = stiffness * L**3 / EI

    def characteristic(b: float) -> float:
        c, s, ch, sh = math.cos(b), math.sin(b), math.cosh(b), math.sinh(b)
        return (1 + c * ch) * b**3 + ratio * (ch * s - sh * c)

    grid = np.linspace(0.5, 9.0, 400)
    values = [characteristic(b) for b in grid]
    signs = np.flatnonzero(np.diff(np.sign(values)))[:2]
    roots = np.array([brentq(characteristic, grid[k], grid[k + 1]) for k in signs])
    found = frequencies(loaded(scene_text(base, spring)))
    assert found[:2] == pytest.approx(roots**2 * math.sqrt(EI / MASS) / L**2, rel=2e-4)


def test_a_bar_on_a_torsional_spring():
    """Hinged at a torsional spring, free at its end: kL/EI (1 + cos cosh) = b (sin cosh - cos sinh) (Blevins 1979)."""
    k = 3.0
    text = scene_text(STANDING.replace("JOINT", "revolute"), f'coil = {{torsional_at = "root", stiffness = {k}}}')

    def characteristic(b: float) -> float:
        c, s, ch, sh = math.cos(b), math.sin(b), math.cosh(b), math.sinh(b)
        return k * L / EI * (1 + c * ch) - b * (s * ch - c * sh)

    roots = np.array([brentq(characteristic, 0.2, 1.8), brentq(characteristic, 3.0, 5.0)])
    found = frequencies(loaded(text))
    assert found[:2] == pytest.approx(roots**2 * math.sqrt(EI / MASS) / L**2, rel=2e-4)


def test_a_stretched_spring_across_is_stiff_by_its_tension():
    """A spring along the beam's axis holds its tip across by T / l alone, and pulls the beam itself straight.

    Tip force F on a cantilever under the tension P: v = F L^3/EI (u - tanh u) / u^3, u^2 = P L^2/EI (Timoshenko & Gere
    1961); without geometric stiffness F L^3 / 3 EI.
    """
    text = scene_text(HELD, 'tip = {between = ["bar.end", "ground.far"], stiffness = 400, length = 0.1}')
    text = changed(text, ("", f"ground.far = [{L + 0.3}, 0]"))
    text += "loads.push = {force_on = 'bar.end', direction = [0, 1], value = 2}\n"
    text += "sensors.tip_y = {displacement = 'bar.end', component = 'y'}\n"
    tension = 400 * 0.2
    u = math.sqrt(tension / EI) * L
    stiffened = 2 / (u**3 / (u - math.tanh(u)) * EI / L**3 + tension / 0.3)
    for geometric, expected in (("true", stiffened), ("false", 2 * L**3 / (3 * EI))):
        settings = ["solve.preset=quasistatic", "bar.elements=16", "solve.steps=4"]
        model = loaded(text, *settings, f"solve.terms.geometric={geometric}")
        found = solve(model).series["tip_y"].values
        assert found == pytest.approx(expected, rel=1e-5), geometric


def test_a_spring_between_two_links():
    """Two equal cantilevers side by side, tips tied: in phase the spring rests, in antiphase it acts doubly."""
    text = machine(
        bodies=dict(one=f"pose = {{}}, {BEAM}", two=f"pose = {{at = [0, 0.1]}}, {BEAM}"), ground=dict(up=[0, 0.1]),
        joints=dict(a="weld ground one.start", b="weld ground.up two.start"),
        springs=dict(tie='between = ["one.end", "two.end"], stiffness = 700, length = 0.1'), solve="duration = 1.0",
    )
    tip = 'tip = {{between = ["ground.below", "bar.end"], stiffness = {}, length = 0.3}}'
    found = frequencies(loaded(text))
    alone, doubled = (frequencies(loaded(scene_text(WELDED, tip.format(k)))) for k in (1e-12, 1400))
    assert found[0] == pytest.approx(alone[0], rel=1e-9)
    assert found[1] == pytest.approx(doubled[0], rel=1e-9)


def test_dampers_take_out_what_the_energy_loses():
    """A cantilever let go from under a force: energy lost = int c v^2 dt of the damper at its tip."""
    tip = 'tip = {between = ["ground.below", "bar.end"], damping = 0.4, stiffness = 10, length = 0.3}'
    text = scene_text(WELDED, tip)
    text += "loads.push = {force_on = 'bar.end', direction = [0, 1], law = '5 * exp(-400 * t)'}\n"
    text += "sensors.pull.spring_force = 'tip'\nsensors.speed.velocity = 'bar.end'\nsensors.speed.component = 'y'\n"
    # gauss takes no energy of its own; radau damps what its steps hardly resolve, here by 1e-4 of what the damper takes
    model = loaded(text, "solve.steps=20000", "solve.duration=0.5", "solve.integrator=gauss")
    solution = solve(model)
    z, v, _ = solution.coordinates
    rigid = model.motion.at(0.0)
    names = {name for monomial in model.equations.K_s.terms for name in monomial}
    K = model.equations.K_s.value({name: float(rigid[name][0]) for name in names})
    M = model.kept["M"].value({name: float(rigid[name][0]) for m in model.kept["M"].terms for name in m})
    energy = 0.5 * np.einsum("it,ij,jt->t", v, M, v) + 0.5 * np.einsum("it,ij,jt->t", z, K, z)
    speed, late = solution.series["speed"].values, solution.times > 0.1  # the force has died away by then
    lost = np.trapezoid(0.4 * speed[late] ** 2, solution.times[late])
    assert lost > 0.1 * energy[late][0]
    assert energy[late][0] - energy[-1] == pytest.approx(lost, rel=1e-5)
    force = 10 * solution.series["tip"].values + 0.4 * speed
    assert solution.series["pull"].values == pytest.approx(force, abs=1e-9 * abs(force).max())


# An elastic arm swings between springs: to the ground from its middle, to its own payload, whose wrist has one, too.
ARM = machine(
    gravity=[0, -9.81], ground=dict(post=[0.3, 0.9]),
    bodies=dict(arm=f"{BEAM}", hand='length = "0.15 m", mass = "0.05 kg"'),
    joints=dict(shoulder="revolute ground arm.start", wrist="revolute arm.end hand.start"),
    drives=dict(shoulder='law = "0.6 * sin(3 * t)"', wrist='law = "0.4 * sin(5 * t)"'),
    damping=dict(rayleigh=dict(ratio=0.05, at=[0.05, 300])),
    springs=dict(band='between = ["ground.post", "arm.mid"], stiffness = 40, length = "0.4 m", damping = 0.5',
                 coil='torsional_at = "wrist", stiffness = 2, damping = 0.01',
                 guy='between = ["arm.start", "hand.end"], stiffness = 30, length = "0.8 m"'),
    sensors=dict(mid="displacement arm.mid y", tip="displacement arm.end y", root="bending_moment arm.start",
                 torque="drive_torque shoulder", wrist="drive_torque wrist", pull_band="spring_force band",
                 pull_guy="spring_force guy", twist="spring_torque coil", wrist_x="joint_force wrist x",
                 wrist_y="joint_force wrist y"),
    solve=dict(duration="1 s", steps=4000),
)


def test_the_coupled_equations_agree():
    """Deflections of some hundredths of the length: what is left is of second order, and modes beyond the third.

    The damping is nearly proportional to the stiffness alone: proportional to mass it acts on the payload, too, in the
    one-way equations, and on the links alone in the coupled ones.
    """
    one_way = solve(loaded(ARM)).series
    coupled = ("solve.preset=coupled", "solve.modes=3", "solve.tolerance=1e-6")
    both = solve(loaded(ARM, *coupled)).series
    within = {"mid": 5e-3, "tip": 5e-3, "root": 1e-2, "torque": 1e-2, "pull_band": 1e-3, "pull_guy": 2e-3,
              "twist": 2e-2, "wrist": 2e-2, "wrist_x": 3e-2, "wrist_y": 2e-2}  # fmt: skip
    alike(one_way, both, within, after=400)


def test_a_damper_on_turning_links_feels_how_fast_its_ends_part():
    """k (l - l_0) + c l', l = e . (end - start) along the rigid mechanism's spring, which turns; of any deformation."""
    places = {"mid": "arm.mid", "hand": "hand.end"}
    table = ARM[ARM.index("sensors.") : ARM.index("solve")]
    sensors = "sensors.pull_band = {spring_force = 'band'}\nsensors.pull_guy = {spring_force = 'guy'}\n"
    for name, place in places.items():
        for axis in "xy":
            sensors += f"sensors.{name}_{axis} = {{position = '{place}', component = '{axis}', axes = 'global'}}\n"
    model, h = loaded(ARM.replace(table, sensors), "solve.preset=linear"), 2e-3
    for instant in (0.15, 0.62):
        t = instant + h * np.arange(-4, 5)
        series = {name: one.values for name, one in waving(model, t, 0.25).series.items()}
        shoulder = 0.6 * np.sin(3 * t)
        hand = shoulder + 0.4 * np.sin(5 * t)
        mid = L / 2 * np.array([np.cos(shoulder), np.sin(shoulder)])
        rigid = {"mid": mid, "hand": 2 * mid + 0.15 * np.array([np.cos(hand), np.sin(hand)])}
        for spring, place, start, k, c, free in (
            ("band", "mid", np.array([[0.3], [0.9]]), 40, 0.5, 0.4), ("guy", "hand", np.zeros((2, 1)), 30, 0.0, 0.8)
        ):  # fmt: skip
            gap = rigid[place] - start
            e = gap / np.hypot(*gap)
            length = (e * (np.array([series[f"{place}_x"], series[f"{place}_y"]]) - start)).sum(axis=0)
            pull = k * (length[4] - free) + c * (STENCIL @ length) / h
            assert series[f"pull_{spring}"][4] == pytest.approx(pull, rel=1e-9), (spring, instant)


def test_the_drives_pay_for_what_springs_store_and_dampers_take():
    """Of the rigid arm: power of the drives = growth of energy + what the dampers take."""
    solution = solve(loaded(ARM, "solve.preset=rigid", "solve.steps=4000"))
    rigid, scene = solution.rigid, solution.model.scene
    power = rigid["shoulder.drive"] * rigid["arm.omega"]
    power = power + rigid["wrist.drive"] * (rigid["hand.omega"] - rigid["arm.omega"])
    energy = 0.5 * 2 * rigid["coil.angle"] ** 2
    for name, body in scene.bodies.items():
        c, s, w = (rigid[f"{name}.{key}"] for key in ("c", "s", "omega"))
        x = body.centre[0]
        v_x, v_y = rigid[f"{name}.v_x"] - w * s * x, rigid[f"{name}.v_y"] + w * c * x
        energy = energy + 0.5 * body.mass * (v_x**2 + v_y**2) + 0.5 * body.inertia * w**2
        energy = energy + body.mass * 9.81 * (rigid[f"{name}.y"] + s * x)
    for name in ("band", "guy"):
        spring = scene.springs[name]
        energy = energy + 0.5 * spring.stiffness * (rigid[f"{name}.length"] - spring.length) ** 2
    rate = np.gradient(rigid["band.length"], solution.times, edge_order=2)
    lost = 0.5 * rate**2 + 0.01 * (rigid["hand.omega"] - rigid["arm.omega"]) ** 2
    gained = np.gradient(energy, solution.times, edge_order=2)
    assert abs(gained + lost - power)[2:-2].max() < 1e-5 * abs(power).max()


@pytest.mark.parametrize(("change", "message"), [
    (("elements = 8}", "elements = 8, axially_rigid = true}"),
     "springs.tip.between = 'bar.end': bar is axially rigid. Leave axially_rigid out, or attach the spring elsewhere."),
    (('"bar.end"]', '"bar.eye"]'),
     "springs.tip.between = 'bar.eye': the point lies off the axis of bar. Move the point onto the axis, "
     "between start and end, or join a rigid body there."),
])  # fmt: skip
def test_what_is_refused(change, message):
    text = scene_text(HELD, 'tip = {between = ["ground.below", "bar.end"], stiffness = 5, length = 0.3}')
    text = text.replace("elements = 8}", "elements = 8}, points = {eye = [0.1, 0.05]}").replace(*change)
    with pytest.raises(SceneError) as error:
        loaded(text)
    assert message in str(error.value)
