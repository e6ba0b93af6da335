"""Assembly of the mechanism's equations against plain dense formulas on hand-written element matrices."""

import closed_forms as by_hand
import numpy as np
import pytest
from runs import at_instant, model
from scipy.sparse import csr_array
from scipy.sparse.csgraph import reverse_cuthill_mckee

from kaneflex.fem.assembly import assemble
from kaneflex.fem.coordinate_map import to_link_axes
from kaneflex.fem.links import Part
from kaneflex.mechanism.affine import Affine, dense_if_small
from kaneflex.multibody.model import building

R, L, SPEED = 0.040, 0.137, 2 * np.pi * 100
PISTON = 0.214
STEEL = {"E": 2.1e11, "rho": 7850.0}


class Bar:
    """A link of one or more elements as dense matrices in its own axes; its motion from closed forms."""

    def __init__(self, length: float, mass: float, I: float, elements: int):
        self.length, self.elements = length, elements
        self.rhoA = mass / length
        self.EA, self.EI = STEEL["E"] * self.rhoA / STEEL["rho"], STEEL["E"] * I

    def chain(self, of_element) -> np.ndarray:
        """Element matrices (6, 6), or vectors (6,), of (length, place of the first node), added up along the link."""
        h, size = self.length / self.elements, 3 * (self.elements + 1)
        first = np.asarray(of_element(h, 0.0))
        total = np.zeros((size,) * first.ndim)
        for k in range(self.elements):
            rows = slice(3 * k, 3 * k + 6)
            total[(rows,) * first.ndim] += of_element(h, k * h)
        return total

    def M(self) -> np.ndarray:
        return self.chain(lambda h, x0: by_hand.mass(self.rhoA, h))

    def G(self) -> np.ndarray:
        return self.chain(lambda h, x0: by_hand.gyration(self.rhoA, h))

    def K_s(self) -> np.ndarray:
        return self.chain(lambda h, x0: by_hand.stiffness(self.EA, self.EI, h))

    def K_g(self, P_0: float, w: float, ax: float) -> np.ndarray:
        """Of P(X) = P_0 + rhoA ax X - rhoA w^2 X^2/2, X along the link."""

        def element(h, x0):
            c0 = P_0 + self.rhoA * (ax * x0 - w**2 * x0**2 / 2)
            return by_hand.geometric(c0, self.rhoA * (ax - w**2 * x0), -self.rhoA * w**2 / 2, h)

        return self.chain(element)

    def F(self, w: float, e: float, ax: float, ay: float) -> np.ndarray:
        def element(h, x0):
            inertia = by_hand.load_acceleration(self.rhoA, h, ax, ay)
            return inertia + by_hand.load_centrifugal(self.rhoA, h, x0, w) + by_hand.load_euler(self.rhoA, h, x0, e)

        return self.chain(element)


CRANK = dict(length=R, mass=0.952, I=7.660080868730307e-7)
ROD = dict(length=L, mass=0.153, I=7.008e-9)


def angles(t: float) -> tuple[float, float]:
    phi = SPEED * t
    return phi, float(by_hand.slider_crank(R, L, phi, SPEED)["phi2"])


def maps(t: float, names: tuple[str, ...], bars: dict[str, Bar]) -> dict[str, np.ndarray]:
    """L(t) of each bar: its nodal coordinates from the mechanism's, written down node after node."""
    found = {}
    for bar, angle in zip(("crank", "rod"), angles(t), strict=True):
        if bar not in bars:
            continue
        last = bars[bar].elements
        rows = np.zeros((3 * (last + 1), len(names)))
        to_link = np.array([[np.cos(angle), np.sin(angle)], [-np.sin(angle), np.cos(angle)]])
        for node in range(last + 1):
            at, end = slice(3 * node, 3 * node + 2), {0: "first", last: "last"}.get(node, "inner")
            if f"{bar}.{node}.theta" in names:
                rows[3 * node + 2, names.index(f"{bar}.{node}.theta")] = 1.0
            if end == "inner":
                rows[3 * node, names.index(f"{bar}.{node}.u")] = 1.0
                rows[3 * node + 1, names.index(f"{bar}.{node}.v")] = 1.0
            elif (bar, end) == ("rod", "last"):
                rows[at, names.index("piston.slide")] = to_link[:, 0]
            elif (bar, end) in (("crank", "last"), ("rod", "first")) and "pin.x" in names:
                rows[at, names.index("pin.x")], rows[at, names.index("pin.y")] = to_link.T
        found[bar] = rows
    return found


def by_formula(t: float, names: tuple[str, ...], bars: dict[str, Bar], gas: float, tension: dict) -> dict:
    """M_z, C_z, K_z, F_z of the design's formulas; L' and L'' by differences of L."""
    h = 2e-3 / SPEED
    steps = [maps(t + k * h, names, bars) for k in (-2, -1, 0, 1, 2)]
    phi, phi_2 = angles(t)
    motion = by_hand.slider_crank(R, L, phi, SPEED)
    pin = -R * SPEED**2 * np.array([np.cos(phi), np.sin(phi)])
    c, s = np.cos(phi_2), np.sin(phi_2)
    kinematics = {
        "crank": (SPEED, 0.0, 0.0, 0.0),
        "rod": (motion["omega2"], motion["epsilon2"], c * pin[0] + s * pin[1], -s * pin[0] + c * pin[1]),
    }
    n = len(names)
    total = {key: np.zeros((n, n)) for key in ("M", "C_d", "K_s", "K_d", "K_g")} | {"F": np.zeros(n)}
    for name, bar in bars.items():
        a, b, L_, c_, d = (step[name] for step in steps)
        rate = (a - 8 * b + 8 * c_ - d) / (12 * h)
        second = (-a + 16 * b - 30 * L_ + 16 * c_ - d) / (12 * h**2)
        w, e, ax, ay = kinematics[name]
        M, C, K_d = bar.M(), 2 * w * bar.G(), -(w**2) * bar.M() + e * bar.G()
        total["M"] += L_.T @ M @ L_
        total["C_d"] += L_.T @ C @ L_ + 2 * L_.T @ M @ rate
        total["K_s"] += L_.T @ bar.K_s() @ L_
        total["K_d"] += L_.T @ K_d @ L_ + L_.T @ C @ rate + L_.T @ M @ second
        total["K_g"] += L_.T @ bar.K_g(tension[name], w, ax) @ L_
        total["F"] += L_.T @ bar.F(w, e, ax, ay)
    slide = names.index("piston.slide")
    total["M"][slide, slide] += PISTON
    total["F"][slide] -= PISTON * motion["piston_acceleration"] + gas
    return total


CASES = {
    "both elastic": ("engine-elastic-crank", ("crank.elements=1", "rod.elements=1")),
    "both elastic, finer": ("engine-elastic-crank", ("crank.elements=2", "rod.elements=3")),
    "rod elastic": ("engine", ("rod.elements=2",)),
}


@pytest.mark.parametrize("degrees", [0.0, 77.0, 180.0, 374.0, 590.0])
@pytest.mark.parametrize("case", CASES)
def test_matrices_of_the_mechanism(case, degrees):
    """L^T M L, L^T C L + 2 L^T M L', L^T K L + L^T C L' + L^T M L'', L^T F, shared pin, released rotations."""
    scene, settings = CASES[case]
    found, t = model(scene, *settings), np.radians(degrees) / SPEED
    elements = {name: len(link.nodes) - 1 for name, link in found.links.items()}
    data = {"crank": CRANK, "rod": ROD}
    bars = {name: Bar(**data[name], elements=elements[name]) for name in elements}
    rigid = found.motion.at(t)
    tension = {name: rigid[f"{name}.link.P_0"][0] for name in bars}
    expected = by_formula(t, found.coordinates, bars, rigid["gas"][0], tension)
    computed = {key: getattr(found, key)(t) for key in ("M", "K_s", "K_d", "K_g", "F")}
    computed["C_d"] = found.C(t) - at_instant(found, found.equations.C_s, t)
    for key, matrix in computed.items():
        assert matrix == pytest.approx(expected[key], abs=1e-8 * np.abs(expected[key]).max()), key


def test_rayleigh_damping_is_formed_in_each_links_own_axes():
    """C_s = L^T (alpha M + beta K_s) L; the guided piston's own mass is damped as well."""
    found, t = model("engine-elastic-crank", "crank.elements=1", "rod.elements=1"), 0.0013
    w_1, w_2 = 2 * np.pi * 3039, 2 * np.pi * 4549
    beta = 2 * 0.02 / (w_1 + w_2)
    alpha = beta * w_1 * w_2
    C_s = at_instant(found, found.equations.C_s, t)
    assert C_s == pytest.approx(alpha * found.M(t) + beta * found.K_s(t), abs=1e-9 * np.abs(C_s).max())
    # Two per cent at both frequencies.
    for w in (w_1, w_2):
        assert (alpha / w + beta * w) / 2 == pytest.approx(0.02)


# ---- one free link with both nodes in global components ---------------------------------------------------------

SCALARS = {"rod.c": np.cos(0.7), "rod.s": np.sin(0.7), "rod.omega": 123.0, "rod.epsilon": 4.5e4}
GLOBAL = tuple(f"node_{k}.{c}" for k in (0, 1) for c in ("x", "y", "theta"))


def in_global_components(matrices: dict[str, Affine]):
    """The equations of one part with T on both nodes' displacements."""

    def selector(rows: tuple[int, ...], columns: tuple[int, ...], shape: tuple[int, int]) -> Affine:
        matrix = np.zeros(shape)
        matrix[list(rows), list(columns)] = 1.0
        return Affine.constant(csr_array(matrix))

    T = selector((2, 5), (2, 5), (6, 6))
    for first in (0, 3):
        place = (first, first + 1)
        T += selector(place, (0, 1), (6, 2)) @ to_link_axes("rod") @ selector((0, 1), place, (2, 6))
    empty = {key: Affine.zero(6, 6) for key in ("M", "C_s", "C_d", "K_s", "K_d", "K_g")} | {"F": Affine.zero(6, 1)}
    part = Part("rod", GLOBAL, empty | matrices, {0: (0, 1, 2), 1: (3, 4, 5)})
    return assemble([(part, T)], GLOBAL)


def test_damping_of_the_material_turns_with_the_link():
    """C_s brings -w T^T C_s S^ T into the stiffness, and that share goes when C_s goes."""
    C_s = by_hand.viscous(3.0, 0.137)
    equations = in_global_components({"C_s": Affine.constant(C_s)})
    T = by_hand.rotation_to_local(SCALARS["rod.c"], SCALARS["rod.s"]).astype(float)
    expected = -SCALARS["rod.omega"] * T.T @ C_s @ by_hand.S_HAT @ T
    assert equations.K_c.value(SCALARS) == pytest.approx(expected, abs=1e-12 * np.abs(expected).max())
    assert not equations.K_d.terms


def test_affine_rates_are_derivatives():
    """c' = -omega s, s' = omega c, omega' = epsilon, against differences."""
    matrix = np.arange(4.0).reshape(2, 2)
    sum_ = Affine.term(("rod.c", "rod.s", "rod.omega"), matrix) + Affine.constant(np.eye(2))

    def at(t: float, affine: Affine) -> np.ndarray:
        angle, w = 0.3 + 2 * t + 1.5 * t**2, 2 + 3 * t
        scalars = {"rod.c": np.cos(angle), "rod.s": np.sin(angle), "rod.omega": w, "rod.epsilon": 3.0}
        return affine.value(scalars)

    h = 1e-5
    assert at(0.2, sum_.rate) == pytest.approx((at(0.2 + h, sum_) - at(0.2 - h, sum_)) / (2 * h), rel=1e-8)
    with pytest.raises(ValueError, match=r"rod\.link\.P_0"):
        _ = Affine.term(("rod.link.P_0",), matrix).rate


@pytest.mark.parametrize(("scene", "count"), [("engine-elastic-crank", 64), ("four-bar", 93)])
def test_what_is_zero_by_structure_is_not_evaluated(scene, count):
    """A crank on a fixed pivot at constant speed has no a_x, a_y and no epsilon, though the rod beside it has them."""
    found = model(scene)
    values = found.scalars(np.linspace(0.0, found.scene.period, 37))
    assert values.any(axis=0).all() and len(found.monomials) == count
    terms = {scalar for monomial in found.monomials for scalar in monomial}
    assert "crank.link.P_0" in terms and not terms & {"crank.link.a_x", "crank.link.a_y", "crank.epsilon"}


def test_constants_of_the_structure_are_put_in():
    c, zero = {"body.c": -1.0}, {"body.c": 0.0}
    affine = Affine.term(("body.c", "body.c", "body.s"), np.eye(2)) + Affine.term(("body.c",), np.ones((2, 2)))
    assert list(affine.fixed(zero).terms) == [] and affine.fixed({}).terms.keys() == affine.terms.keys()
    assert (affine.fixed(c).value({"body.s": 3.0}) == [[2.0, -1.0], [-1.0, 2.0]]).all()


@pytest.mark.parametrize("size", [1, 13, 17, 60, 120])  # 120 is kept as a sparse matrix
def test_coordinates_are_ordered_as_by_scipy(size):
    """The order decides the last digits of every result of a scene with loops."""
    random = np.random.default_rng(size)
    for share in (0.01, 0.05, 0.3):
        pattern = csr_array((random.random((size, size)) < share) | np.eye(size, dtype=bool), dtype=float)
        pattern = pattern + pattern.T
        expected = reverse_cuthill_mckee(pattern, symmetric_mode=True)
        assert building._reverse_cuthill_mckee(dense_if_small(pattern)) == expected.tolist()
