"""At a change point there are no modes: a run does without them and says so, who asks for them is told where else."""

from command_line import cli, refused, unrendered

PARALLELOGRAM = """
schema = 1
gravity = [0, "-9.81 m/s^2"]
ground = {P = ["0.3 m", 0]}
[bodies]
crank = {length = "0.1 m", mass = "0.2 kg"}
coupler = {length = "0.3 m", beam = {material = "steel", section = {rectangle = ["4 mm", "20 mm"]}}}
rocker = {length = "0.1 m", mass = "0.2 kg"}
[joints]
A = {revolute = ["ground", "crank.start"]}
B = {revolute = ["crank.end", "coupler.start"]}
D = {revolute = ["ground.P", "rocker.start"]}
C = {revolute = ["coupler.end", "rocker.end"], branch = "+"}
[drives]
A = {free = true, angle = 1.0, initial_speed = "20 rad/s"}
[sensors]
phi = {position = "A", component = "angle"}
[solve]
preset = "coupled"
duration = "0.4 s"
steps = 160
"""


def test_a_run_through_a_change_point_is_written(tmp_path, monkeypatch):
    unrendered(monkeypatch)
    file, out = tmp_path / "scene.toml", tmp_path / "out"
    file.write_text(PARALLELOGRAM)
    result = cli("run", file, "-o", out, "--frames", 2, "--set", "solve.errors=none")
    assert result.exit_code == 0, result.stderr
    said = "no modes at solve.mode_angle = 0 deg, a dead centre or a change point, where A does not say how"
    assert said in " ".join((result.stdout + result.stderr).split())
    assert (out / "summary.json").exists()


def test_modes_of_a_change_point_are_refused_with_the_cure(tmp_path):
    file = tmp_path / "scene.toml"
    file.write_text(PARALLELOGRAM)
    refused(cli("modes", file), "solve.mode_angle = '0 deg'", "Choose another place")
