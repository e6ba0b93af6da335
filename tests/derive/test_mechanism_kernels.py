"""Kernels of the whole mechanism: what a run integrates and your own loop, checked ones, operations of chains."""

import ast
import doctest
import io
import re
import subprocess
import sys
from contextlib import redirect_stdout

import numpy as np
import pytest
from chains import chain
from places import DOCS
from runs import at_instant, model, run, tables

import kaneflex
from kaneflex.derive.generate import generate
from kaneflex.generated import beam_timoshenko, engine
from kaneflex.mechanism import kernels as compiled
from kaneflex.scene import Scene
from kaneflex.solve.loading import integrated
from kaneflex.support import checking
from kaneflex.support.errors import SceneError

T = 0.0037


def called(kernels, name: str, t: float = T) -> np.ndarray:
    out = np.full(kernels.shapes[name]["out"], np.nan)
    getattr(kernels, name)(t, kernels.parameters, out)
    return out


CASES = {
    "stiffened": ("engine-elastic-crank", (), set()),
    "without terms": ("engine", ("solve.preset=linear", "solve.terms={damping=false}"), {"K_g", "K_c"}),
    "modes of each link": ("engine", ("solve.modes=3",), set()),
    "modes of the whole": ("engine", ("solve.preset=paper", "solve.modes=2"), {"K_d", "K_c", "K_g"}),
    "by Newton's method": ("six-bar", (), set()),
    "moved by forces": ("spin-up-torque", ("solve.preset=stiffened",), {"K_c"}),
}


@pytest.mark.parametrize("case", CASES)
def test_they_are_what_is_integrated(case):
    """M, C, K, F and K's parts by their sums of monomial x matrix; what the options leave out is zero."""
    scene, settings, zero = CASES[case]
    found = integrated(model(scene, *settings))
    kernels, t = found.kernels, 0.37 * found.options.duration
    assert kernels.coordinates == found.reduced.coordinates and len(kernels.coordinates) > 0
    parts = ("K_s", "K_d", "K_c", "K_g")
    for name in ("M", "C", "K", "F", *parts):
        expected = at_instant(found, found.kept_parts[name], t).reshape(kernels.shapes[name]["out"])
        assert called(kernels, name, t) == pytest.approx(expected, abs=1e-13 * abs(expected).max()), name
        assert name not in parts or (not expected.any()) == (name in zero), name
    (row,) = found.scalars(np.array([t]))
    four = [np.full(kernels.shapes[name]["out"], np.nan) for name in "MCKF"]
    kernels.equations(t, kernels.parameters, *four)
    for name, matrix in zip("MCKF", four, strict=True):
        expected = found.system.dense(name, row)
        assert matrix == pytest.approx(expected, abs=1e-13 * abs(expected).max())
    whole = sum(called(kernels, name, t) for name in parts)
    assert called(kernels, "K", t) == pytest.approx(whole, abs=1e-12 * abs(whole).max())


def test_places_of_the_slider_crank():
    """x = r cos + l cos(asin(r/l sin)) of the piston, half of each link at its middle."""
    kernels, r, l = model("engine").kernels, 0.040, 0.137
    angle = 2 * np.pi * 100 * T
    pin = r * np.array([np.cos(angle), np.sin(angle)])
    wrist = np.array([pin[0] + np.sqrt(l**2 - pin[1] ** 2), 0.0])
    expected = {"crank.mid": pin / 2, "crank.end": pin, "rod.mid": (pin + wrist) / 2, "piston.start": wrist}
    found = dict(zip(kernels.points, called(kernels, "positions"), strict=True))
    for point, place in expected.items():
        assert found[point] == pytest.approx(place, abs=1e-15), point


def test_inverse_dynamics_balances_the_power():
    """Torque x speed = rate of kinetic energy + power of the gas, differenced over the turn."""
    found = model("engine")
    kernels, scene, h = found.kernels, found.scene, 1e-6
    assert kernels.forces["main.drive"] == "N m" and kernels.forces["bore.normal"] == "N"

    def kinetic(t: float) -> float:
        """Of crank, rod and piston by their masses, from the motion alone."""
        rigid, total = found.motion.at(t), 0.0
        for name, body in scene.bodies.items():
            x, y = body.centre
            c, s, w = (rigid[f"{name}.{key}"][0] for key in ("c", "s", "omega"))
            v = rigid[f"{name}.v_x"][0] - w * (s * x + c * y), rigid[f"{name}.v_y"][0] + w * (c * x - s * y)
            total += 0.5 * body.mass * (v[0] ** 2 + v[1] ** 2) + 0.5 * body.inertia * w**2
        return total

    for t in (0.0012, T, 0.0081):
        torque = dict(zip(kernels.forces, called(kernels, "inverse_dynamics", t), strict=True))["main.drive"]
        rigid = found.motion.at(t)
        gas = -rigid["gas"][0] * rigid["piston.v_x"][0]
        rate = (kinetic(t + h) - kinetic(t - h)) / (2 * h)
        assert torque * 2 * np.pi * 100 == pytest.approx(rate - gas, rel=1e-6)


@pytest.fixture(scope="module")
def page() -> dict[str, object]:
    """What docs/kernels.md defines, its Python run from top to bottom; and what it prints."""
    text = (DOCS / "kernels.md").read_text(encoding="utf-8")
    code = "\n".join(re.findall(r"```python\n(.*?)```", text, flags=re.DOTALL))
    namespace, printed = {}, io.StringIO()
    with redirect_stdout(printed):
        exec(compile(code, "docs/kernels.md", "exec"), namespace)
    promised = re.findall(r"^ *print\(.*\)  # (.*)$", code, flags=re.MULTILINE)
    return namespace | {"printed": printed.getvalue().splitlines(), "promised": promised, "text": text}


def test_the_page_prints_what_it_says(page):
    """A loop of one's own by Newmark's method is the run by the runtime's; places, torque, a refusal."""
    assert page["printed"] == page["promised"] and len(page["promised"]) == 3
    table = re.findall(r"^\| (`.*?) \| ", page["text"], flags=re.MULTILINE)
    named = {name for cell in table for name in re.findall(r"`(\w+)", cell)}
    assert named == set(page["kernels"].shapes)


def test_a_loop_of_ones_own_serves_any_mechanism(page):
    """The page's loop over 400 steps of a spinning beam, compiled once for it and the engine."""
    solution = run("rotating-cantilever", "solve.integrator=newmark", "solve.steps=2000")
    of, start = solution.model, [series[:, 0].copy() for series in solution.coordinates]
    ends = page["newmark"](of.kernels.parameters, *start, of.step, round(solution.times[400] / of.step))
    for found, series in zip(ends, solution.coordinates, strict=True):
        assert found == pytest.approx(series[:, 400], abs=1e-8 * abs(series).max())
    assert len(page["newmark"].signatures) == 1


FRESH = """
import kaneflex, numpy as np
from kaneflex.mechanism import kernels as compiled
kernels = kaneflex.load(kaneflex.read_scene("four-bar")).kernels
out = np.empty(kernels.shapes["K"]["out"])
kernels.K(0.01, kernels.parameters, out)
print(sum(compiled.K.stats.cache_hits.values()), sum(compiled.K.stats.cache_misses.values()), repr(out[0, 0]))
"""


def test_they_are_compiled_once_for_all_mechanisms_and_processes():
    called(model("engine").kernels, "K")
    assert len(compiled.K.signatures) == 1
    done = subprocess.run([sys.executable, "-c", FRESH], capture_output=True, text=True, timeout=300)
    assert done.stdout.split()[:2] == ["1", "0"], done.stderr


def test_checked_kernels_name_what_does_not_fit():
    own, other = model("engine").kernels, model("four-bar").kernels
    safe, n = kaneflex.checked(own), len(own.coordinates)
    assert (called(safe_with(safe, own), "K") == called(own, "K")).all()
    assert safe.points == own.points and safe.parameters is own.parameters
    for kernel, arguments, message in (
        ("M", (T, own.parameters, np.zeros((n, n + 1))), rf"M: out has shape \({n}, {n + 1}\), \({n}, {n}\) is"),
        ("F", (T, own.parameters, np.zeros((n, 1))), rf"F: out has shape \({n}, 1\), \({n},\) is required"),
        ("K", (T, own.parameters, np.zeros((n, n)).T[::-1]), "K: out is not contiguous"),
        ("K", (T, own.parameters, np.zeros((n, n), np.float32)), "K: out is an array of float32"),
        ("C", (T, other.parameters, np.zeros((n, n))), "C: p belongs to another mechanism"),
        ("K_g", (T, own.parameters.numbers, np.zeros((n, n))), "K_g: p is a ndarray, the parameters of the kernels"),
        ("positions", (T, own.parameters, np.zeros((2, 2))), r"positions: out has shape \(2, 2\), \(7, 2\)"),
        ("equations", (T, own.parameters, *[np.zeros((n, n))] * 3, np.zeros(3)), r"equations: F has shape \(3,\)"),
    ):
        with pytest.raises((TypeError, ValueError), match=message):
            getattr(safe, kernel)(*arguments)


def safe_with(safe, own):
    """Checked kernels with the shapes of the others, for `called`."""
    safe.shapes = own.shapes
    return safe


def test_kernels_of_free_joints_are_those_of_a_run():
    found = model("engine-torque", "solve.duration=2 ms", "solve.steps=20", "solve.errors=none")
    with pytest.raises(SceneError, match=r"a run integrates it\. Use the model of a run"):
        _ = found.kernels
    moved = kaneflex.simulate(found).model
    places = called(moved.kernels, "positions", 0.001)
    point = moved.kernels.points.index("rod_1.start")
    rigid = moved.motion.at(0.001)
    assert places[point] == pytest.approx([rigid["rod_1.x"][0], rigid["rod_1.y"][0]], abs=1e-12)


def test_coupled_equations_have_kernels_of_their_own():
    with pytest.raises(SceneError, match=r"solve.preset = 'coupled': its M, K and F depend.*project"):
        _ = model("elastic-pendulum").kernels


def test_a_mechanism_of_rigid_bodies_has_places_and_forces():
    found = model("engine", "solve.preset=rigid")
    kernels = found.kernels
    assert called(kernels, "K").shape == (0, 0) and called(kernels, "positions").shape == (7, 2)
    torque = called(kernels, "inverse_dynamics")[list(kernels.forces).index("main.drive")]
    assert torque == pytest.approx(found.motion.at(T)["main.drive"][0], rel=1e-14)


def test_checked_kernels_compute_the_same():
    safe, p, s = kaneflex.checked(engine), np.array([1.1, 3e7, 1500.0, 0.03, 0.06]), np.linspace(1.0, 2.0, 5)
    assert safe.PARAMETERS is engine.PARAMETERS
    for name, more in (("M", ()), ("K_g", (s,)), ("F", (s,))):
        shape = {"F": (6,)}.get(name, (6, 6))
        found, plain = np.zeros(shape), np.zeros(shape)
        getattr(safe, name)(p, *more, found)
        getattr(engine, name)(p, *more, plain)
        assert (found == plain).all() and found.any()
    motion = model("engine").motion
    out, plain = np.zeros((2, 3, len(engine.SCALARS)))
    for kernels, found in ((safe, out), (engine, plain)):
        kernels.tabulate(np.array([0.0, 0.01, 0.02]), motion.parameters, found)
    assert (out == plain).all() and out.any()


def test_every_kernel_of_a_module_is_checked():
    for module in (engine, beam_timoshenko, model("four-bar").module, model("elastic-pendulum").coupled.module):
        safe = kaneflex.checked(module)
        kernels = [name for name, value in vars(module).items() if hasattr(value, "py_func")]
        plain = {name.rstrip("_0123456789") for name in kernels if getattr(safe, name) is getattr(module, name)}
        assert plain <= {"table", "table_rate", "table_curvature"}


@pytest.mark.parametrize(("kernel", "arguments", "message"), [
    ("K_s", (np.zeros(4), np.zeros((6, 6))), r"K_s: p has shape \(4,\), at least \(5,\) is required"),
    ("K_s", (np.zeros(5), np.zeros((5, 6))), r"K_s: out has shape \(5, 6\), \(6, 6\) is required"),
    ("K_g", (np.zeros(5), np.zeros(4), np.zeros((6, 6))), r"K_g: s has shape \(4,\)"),
    ("F", (np.zeros(5), np.zeros(5), np.zeros((6, 1))), r"F: out has shape \(6, 1\), \(6,\) is required"),
    ("M", ([1.0] * 5, np.zeros((6, 6))), "M: p is a list, an array of float64 is required"),
    ("M", (np.zeros(5, np.float32), np.zeros((6, 6))), "M: p is an array of float32"),
    ("motion", (0.0, np.zeros(19), np.zeros(9)), r"motion: s has shape \(9,\)"),
    ("motion", (0.0, np.full(19, 30.0), np.zeros(33)), "does not hold the whole table of loads.gas.table"),
    ("tabulate", (np.zeros(3), np.zeros(19), np.zeros((2, 33))), "out has 2 rows for 3 times"),
])  # fmt: skip
def test_what_would_be_read_beyond_its_end_is_refused(kernel, arguments, message):
    with pytest.raises((TypeError, ValueError), match=message):
        getattr(kaneflex.checked(engine), kernel)(*arguments)


def test_the_docstrings_example():
    assert doctest.testmod(checking).failed == 0


def operations(scene: Scene) -> int:
    """Operations of the kernel ``motion`` as it is emitted."""
    return tables(ast.parse(generate(scene)))["OPERATIONS"]["motion"][1]


@pytest.mark.exhaustive(share=2)
@pytest.mark.parametrize(("closed", "counts"), [(False, (2, 3, 4)), (True, (4, 5, 6))])
def test_each_link_adds_the_same_number_of_operations(closed, counts, tmp_path):
    """A pose is its predecessor's and one turn more, a reaction what its neighbours leave: shared, each link costs
    alike.

    Written out, the terms of the last link hold the turns of all others and multiply with each of them.
    """
    found = [operations(chain(count, closed, tmp_path)) for count in counts]
    a_link = [(b - a) / (n - m) for a, b, m, n in zip(found, found[1:], counts, counts[1:], strict=False)]
    assert a_link[1] == pytest.approx(a_link[0], rel=0.02)
    assert 30 < a_link[0] < 100
