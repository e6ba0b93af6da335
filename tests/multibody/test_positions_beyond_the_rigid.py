"""Positions of a deformed mechanism where its rigid mechanism does not close: they are known, and read."""

import numpy as np
import pytest
from machines import machine
from runs import solved, starts_of

from kaneflex.scene.read import scene_of

VALVE_TRAIN = machine(
    description="OHV valve train: cam of two circles, flat tappet, elastic pushrod and rocker, valve on a spring",
    ground=dict(guide=["60 mm", 0], rocker=["30 mm", "245 mm"], seat=["60 mm", "270 mm"]),
    bodies=dict(cam='mass = "1 kg", inertia = "2e-4 kg m^2", points = {nose = [0, "10 mm"]}',
                tappet='mass = "60 g", points = {face = [0, 0], cup = [0, "20 mm"]}',
                pushrod='length = "207 mm", '
                        'beam = {material = "steel", section = {tube = ["8 mm", "1.2 mm"]}, elements = 4}',
                arm1='length = "30 mm", '
                     'beam = {material = "steel", section = {rectangle = ["18 mm", "12 mm"]}, elements = 2}',
                arm2='length = "30 mm", '
                     'beam = {material = "steel", section = {rectangle = ["18 mm", "12 mm"]}, elements = 2}',
                link='length = "20 mm", mass = "8 g"', valve='mass = "110 g"'),
    joints=dict(shaft="revolute ground cam", bore="prismatic ground tappet, direction = [0, 1]",
                pivot="revolute ground.rocker arm2.start",
                stiff='weld arm2.start arm1.start, relative_angle = "180 deg"', cup="revolute tappet.cup pushrod.start",
                ball="revolute pushrod.end arm1.end, near = {pushrod = '90 deg'}", tip="revolute arm2.end link.start",
                stem="revolute link.end valve",
                vguide='prismatic ground.guide valve, direction = [0, 1], branch = "-"'),
    drives=dict(shaft='speed = "1500 rpm", cycle = "360 deg", angle = "180 deg"',
                bore='free = true, position = "18 mm"'),
    contacts=dict(base='point_on_line = ["cam", "tappet.face"], normal = [0, -1], radius = "18 mm", '
                       'contact = {stiffness = 3e9, restitution = 0.5}',
                  nose='point_on_line = ["cam.nose", "tappet.face"], normal = [0, -1], radius = "14 mm", '
                       'contact = {stiffness = 3e9, restitution = 0.5}'),
    springs=dict(coil='between = ["ground.seat", "valve"], stiffness = "30 N/mm", damping = 10, length = "75 mm"'),
    damping=dict(rayleigh=dict(ratio="2 %", at=["500 Hz", "8 kHz"])),
    sensors=dict(lift="position valve y", stroke="position vguide x", tilt="position link angle",
                 speed="velocity valve y", push="acceleration valve y", middle="position pushrod.mid y"),
    solve=dict(preset="coupled", duration="8 ms", steps=400, modes=2, tolerance=1e-9, errors="none"),
)
"""As ``shared/cases/position_nan.toml`` has it, for a shorter time and with more sensors."""


@pytest.fixture(scope="module")
def valve_train():
    return solved(scene_of(VALVE_TRAIN))


def test_positions_and_rates_have_values_where_the_rigid_mechanism_does_not_close(valve_train):
    found, series = valve_train, valve_train.series
    lost = ~np.isfinite(found.rigid["valve.y"])
    assert 10 < lost.sum() < 100 and all(np.isfinite(each.values).all() for each in series.values())
    assert not [text for text in found.warnings if "has no value" in text]
    k = starts_of(found.model.coupled)["valve"] + 1
    trajectory = found.trajectory
    assert series["lift"].values == pytest.approx(trajectory.q[:, k], rel=1e-12)
    assert series["speed"].values == pytest.approx(trajectory.v[:, k], rel=1e-12)
    assert series["push"].values == pytest.approx(trajectory.a[:, k], rel=1e-12)


def test_they_are_what_they_are_elsewhere(valve_train):
    """Beside the instants without a rigid mechanism, by its place and the displacement from it."""
    found = valve_train
    there = np.isfinite(found.rigid["valve.y"])
    for body, point, sensor in (("valve", (0.0, 0.0), "lift"), ("pushrod", (0.1035, 0.0), "middle")):
        frame, moved = found.rigid.frame(body), found.motion.displacement(body, point)[0]
        expected = frame.place(np.reshape(point, (2, 1)) + moved[:2])[1]
        assert found.series[sensor].values[there] == pytest.approx(expected[there], rel=1e-12)
    turned = found.motion.turned("link") + found.motion.displacement("link")[0][2]
    assert found.series["tilt"].values[there] == pytest.approx(turned[there], abs=1e-12)
