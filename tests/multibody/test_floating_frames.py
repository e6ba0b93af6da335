"""Links under preset coupled know no direction: which of their ends is the start changes nothing that can be seen."""

import math
from copy import deepcopy

import numpy as np
import pytest
from machines import pendulum
from runs import closed, counts_of, gaps, shapes_of, solved, starts_of
from scipy.linalg import eigh

import kaneflex
from kaneflex.fem.links import make_link
from kaneflex.mechanism.mechanism import mechanism_of
from kaneflex.multibody.model.assembly import build_system
from kaneflex.multibody.model.shape_bases import link_shapes
from kaneflex.scene import read_scene, scene_of, with_settings
from kaneflex.scene.options import modes_of
from kaneflex.scene.read import _validated

COUPLED = [
    "elastic-double-pendulum", "elastic-pendulum", "engine-torque-elastic", "four-bar-motor",
    "slider-crank-150-coupled", "spin-up-torque",
]  # fmt: skip
T = 0.013
"""An instant under way [s]."""
BAR = """
schema = 1
bodies.bar = {{length = "500 mm", beam = {{material = "steel", A = "40 mm^2", I = "133.33 mm^4", elements = 6}}}}
solve = {{preset = "coupled", modes = 2, duration = "{duration}", steps = 200}}
"""


def bar(duration, *entries):
    return solved(scene_of(BAR.format(duration=duration) + "\n".join(entries)))


def clamped(held, free, turn):
    return bar(
        "0.06 s", f'joints.wall = {{weld = ["ground", "bar.{held}"], relative_angle = "{turn}"}}',
        f'loads.push = {{force_on = "bar.{free}", direction = [0, -1], law = "20 * sin(10 * pi * t)"}}',
        f'sensors.x = {{position = "bar.{free}", component = "x"}}',
        f'sensors.y = {{position = "bar.{free}", component = "y"}}',
        'sensors.moment = {joint_force = "wall", component = "angle"}',
    )  # fmt: skip


def test_a_cantilever_may_be_clamped_at_its_end():
    """The tip moves by 7 % of the length."""
    by_start, by_end = clamped("start", "end", "0 deg"), clamped("end", "start", "180 deg")
    assert by_end.outcome.name == "COMPLETED"
    assert abs(by_start.series["y"].values).max() > 0.03
    for name, tolerance in (("x", 1e-8), ("y", 1e-8), ("moment", 1e-4)):
        assert by_end.series[name].values == pytest.approx(by_start.series[name].values, abs=tolerance), name


def test_a_strip_driven_at_its_middle_bends_as_two_cantilevers():
    """Slow pushes at both tips: each half by P l^3 / (3 E I) but for the finite deflection's share, 1e-3."""
    loads = "\n".join(
        f'loads.{end}_push = {{force_on = "bar.{end}", direction = [0, -1], law = "30 * (1 - cos(pi * t / 0.2)) / 2"}}'
        for end in ("start", "end")
    )
    sensors = "\n".join(f'sensors.{end}_y = {{position = "bar.{end}", component = "y"}}' for end in ("start", "end"))
    found = bar("0.2 s", 'joints.hub = {revolute = ["ground", "bar.mid"]}\ndrives.hub = {speed = 0}', loads, sensors)
    assert found.outcome.name == "COMPLETED"
    left, right = (found.series[name].values for name in ("start_y", "end_y"))
    assert left == pytest.approx(right, abs=1e-8)
    deflection = 30 * 0.25**3 / (3 * 2.1e11 * 133.33e-12)
    assert -left[-1] == pytest.approx(deflection, rel=5e-3)


# ---- every shipped coupled scene -----------------------------------------------------------------------------------


def reversed_links(scene):
    """The scene with start and end of every elastic link exchanged, and drives that count from the same places."""
    raw = deepcopy(scene.raw)
    links = {name for name, body in scene.bodies.items() if body.elastic}
    other = {"start": "end", "end": "start"}

    def swapped(address):
        body, _, point = address.partition(".")
        return f"{body}.{other.get(point or 'start', point)}" if body in links else address

    for joint in raw["joints"].values():
        for kind in ("revolute", "prismatic", "weld"):
            if kind in joint:
                joint[kind] = [swapped(address) for address in joint[kind]]
    for mass in raw.get("masses", {}).values():
        mass["at"] = swapped(mass["at"])
    for name, drive in scene.drives.items():
        first, second = (address.body in links for address in scene.joints[name].addresses)
        if scene.joints[name].kind == "revolute":
            raw["drives"][name]["angle"] = drive.start + math.pi * (int(second) - int(first))
    raw["sensors"], raw["events"] = {}, {}
    return _validated(raw, scene.source), links


def moved_state(system, q, v, seed):
    """q and v on the loops, from those of a rigid mechanism under way: its shapes deflect by per mille, and move."""
    random = np.random.default_rng(seed)
    q, v = q.copy(), v.copy()
    for name in starts_of(system):
        modal, axial = shapes_of(system, name), counts_of(system)[name][0]
        q[modal], v[modal] = 5e-3 * random.normal(size=(2, modal.stop - modal.start))
        q[modal.start : modal.start + axial] *= 0.2
        v[modal.start : modal.start + axial] *= 2.0
        v[modal.start + axial : modal.stop] *= 200.0
    found = closed(system, T, q, v)
    return found.q[0], found.v[0]


def seen_from_the_end(system, other, links, q, v):
    """q and v of the reversed system in the same state, and what leads from its modal coordinates to the old ones."""
    there, rates, back = q.copy(), v.copy(), {}
    for name in starts_of(system):
        if name not in links:
            continue
        link, old, new = system.links[name], system.shapes[name], other.shapes[name]
        mirrored = [part.reshape(-1, 3, part.shape[1])[::-1] for part in (new.axial, new.transverse)]
        mirrored = [(part * [[-1.0], [-1.0], [1.0]]).reshape(-1, part.shape[2]) for part in mirrored]
        axial, bending = (
            np.linalg.lstsq(mine, part, rcond=None)[0]
            for mine, part in zip((old.axial, old.transverse), mirrored, strict=True)
        )
        for mine, part, by in zip((old.axial, old.transverse), mirrored, (axial, bending), strict=True):
            assert abs(mine @ by - part).max(initial=0.0) < 1e-9, name  # the same space
        k, modal, s = starts_of(system)[name], shapes_of(system, name), axial.shape[1]
        b, b_rate, a, a_rate = q[modal][:s], v[modal][:s], q[modal][s:], v[modal][s:]
        there[modal] = np.concatenate([np.linalg.solve(axial, b), np.linalg.solve(bending, a)])
        rates[modal] = np.concatenate([np.linalg.solve(axial, b_rate), np.linalg.solve(bending, a_rate)])
        along = link.length * np.array([np.cos(q[k + 2]), np.sin(q[k + 2])])
        there[k : k + 2] += along
        there[k + 2] += np.pi
        rates[k : k + 2] += v[k + 2] * np.array([-along[1], along[0]])
        back[name] = (axial, bending)
    return there, rates, back


@pytest.mark.parametrize("name", COUPLED)
def test_accelerations_and_reactions_know_no_direction(name):
    """Of all bodies and joints of a shipped scene with its links reversed, bent as it never is."""
    scene = read_scene(name)
    turned, links = reversed_links(scene)
    model = kaneflex.load(scene)
    system, other = model.coupled, build_system(turned, lambda stage: None, modes_of(turned.solve))[0]
    system.engine.set(*model.motion.states(system, np.array([T])))
    record = system.unfold(system.engine.row(T)[None])[0]
    q, v = moved_state(system, record[system.record.q], record[system.record.v], 7)
    there, rates, back = seen_from_the_end(system, other, links, q, v)
    found, mirrored = closed(system, T, q, v), closed(other, T, there, rates)
    assert mirrored.q[0] == pytest.approx(there, abs=1e-10) and mirrored.v[0] == pytest.approx(rates, abs=1e-8)
    assert max(abs(gap) for gap in gaps(other, T, there).values()) < 1e-10
    (a,), (reactions,), (a_there,), (reactions_there,) = found.a, found.multipliers, mirrored.a, mirrored.multipliers
    assert reactions_there == pytest.approx(reactions, rel=1e-7, abs=1e-9 * abs(reactions).max())
    energies = [of.engine.instants(each.record).energies[0, :2] for of, each in ((system, found), (other, mirrored))]
    assert energies[1] == pytest.approx(energies[0], rel=1e-9)
    for body, k in starts_of(system).items():
        assert a_there[k + 2] == pytest.approx(a[k + 2], rel=1e-7, abs=1e-9 * abs(a).max()), body
        if body not in links:
            assert a_there[k : k + 2] == pytest.approx(a[k : k + 2], rel=1e-7, abs=1e-9 * abs(a).max()), body
            continue
        modal, found = shapes_of(system, body), a_there[shapes_of(system, body)]
        s = back[body][0].shape[1]
        mapped = np.concatenate([back[body][0] @ found[:s], back[body][1] @ found[s:]])
        assert mapped == pytest.approx(a[modal], rel=1e-6, abs=1e-8 * abs(a[modal]).max()), body


# ---- axial modes ---------------------------------------------------------------------------------------------------

ROD = pendulum(
    'length = "500 mm", beam = {material = "steel", A = "40 mm^2", I = "133.33 mm^4", elements = 32}', "speed = 0",
    "rod", "pin", loads='pull = {force_on = "rod.end", direction = [1, 0], law = "t"}',
    solve={"preset": "coupled", "duration": "1 s"},
)


def test_axial_frequencies_converge_with_modes():
    """Of a rod held at one end, (2 k - 1) / 4 sqrt(E / rho) / L, where something pulls at the other one."""
    exact = (2 * np.arange(1, 5) - 1) / 4 * math.sqrt(2.1e11 / 7850) / 0.5
    errors, linear = [], with_settings(scene_of(ROD), ["solve.preset=linear"])
    module = kaneflex.load(linear).motion.module
    for modes in (3, 6, 12):
        scene = with_settings(linear, ["solve.preset=coupled", f"solve.modes={modes}"])
        link = make_link(mechanism_of(scene), "rod", 32, module)
        shapes = link_shapes(link, modes).axial
        K, M = (shapes.T @ link.part.matrices[key].value({}) @ shapes for key in ("K_s", "M"))
        found = np.sqrt(eigh(K, M, eigvals_only=True)) / (2 * np.pi)
        errors.append(found[:4] / exact[: len(found)][:4] - 1)
    first, second = np.array([found[:2] for found in errors]).T
    assert abs(first).max() < 5e-4  # 32 elements leave 1e-4
    assert second[1] < 0.03 and second[2] < 2e-3 and (np.diff(second) < 0).all()
    assert errors[2][2] < 0.015
