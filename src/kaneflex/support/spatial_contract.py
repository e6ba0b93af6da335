"""Contract of spatial elements: parameters, scalars of the motion and terms; ``contract`` has the planar ones.

A node has the coordinates u, v, w, theta_x, theta_y, theta_z in link axes: x along the link, y and z the principal axes
of its sections. theta_z = v' and theta_y = -w' if sections stay normal to the axis.
"""

from itertools import combinations_with_replacement

AXES = "xyz"

SPATIAL_LINK_SCALARS = (
    *((f"omega_{axis}", "rad/s", f"angular velocity of the link frame about its {axis}") for axis in AXES),
    *((f"epsilon_{axis}", "rad/s^2", f"angular acceleration of the link frame about its {axis}") for axis in AXES),
    *((f"a_{axis}", "m/s^2", f"acceleration of the link's origin minus gravity, along its {axis}") for axis in AXES),
    ("P_0", "N", "axial force at the link's origin, tension positive"),
)
"""Motion scalars of one elastic link, in the order in which every element kernel reads its argument ``s``."""

SPATIAL_NODE = ("u", "v", "w", "theta_x", "theta_y", "theta_z")
"""Coordinates of a node in link axes [m, rad]."""

_DENSITIES = (
    ("rho_A", "kg/m", "mass per length"),
    ("rho_I_y", "kg m", "rotary inertia per length about the section's y, rho int z^2 dA"),
    ("rho_I_z", "kg m", "rotary inertia per length about the section's z, rho int y^2 dA; about x it is the sum"),
)
_RIGIDITIES = (
    ("E_I_y", "N m^2", "bending stiffness about y, of w"),
    ("E_I_z", "N m^2", "bending stiffness about z, of v"),
)
_UNIFORM = (
    ("E_A", "N", "axial stiffness"),
    ("G_J", "N m^2", "torsional stiffness, J after Saint-Venant"),
    ("I_p_A", "m^2", "polar second moment of area over area, by which an axial force stiffens torsion"),
    ("length", "m", "length of the element"),
    ("x_0", "m", "distance of the element's first node from the link's origin"),
)
_SHEAR = (
    ("phi_y", "1", "flexibility in shear along y, 12 E I_z / (k_y G A length^2)"),
    ("phi_z", "1", "flexibility in shear along z, 12 E I_y / (k_z G A length^2)"),
)
_VARYING = (
    *((f"{name}_rise", unit, f"growth of {name} over the element") for name, unit, _ in _DENSITIES + _RIGIDITIES),
    ("m_0", "kg", "mass of the link before the element"),
    ("S_0", "kg m", "first moment of that mass about the link's origin"),
)


def spatial_element_parameters(shear: bool, varying: bool) -> tuple[tuple[str, str, str], ...]:
    """Name, unit and meaning of an element's parameters, in the order in which its kernels read them.

    For a varying section, parameters with a growth are means over the element.
    """
    return _DENSITIES + _RIGIDITIES + _UNIFORM + _VARYING * varying + _SHEAR * shear


_PAIRS = tuple(combinations_with_replacement(AXES, 2))


def _omega(i: str, j: str) -> tuple[str, str]:
    return f"omega_{i}", f"omega_{j}"


SPATIAL_ELEMENT_TERMS = (
    ("mass", "inertia", "M", ()),
    *((f"gyroscopic_{i}", "gyroscopic", "C", (f"omega_{i}",)) for i in AXES),
    *((f"spin_{i}{j}", "spin", "K_d", _omega(i, j)) for i, j in _PAIRS),
    *((f"euler_{i}", "euler", "K_d", (f"epsilon_{i}",)) for i in AXES),
    *((f"centrifugal_load_{i}{j}", "load", "F", _omega(i, j)) for i, j in _PAIRS if (i, j) != ("x", "x")),
    *((f"euler_load_{i}", "load", "F", (f"epsilon_{i}",)) for i in AXES),
    *((f"load_{i}", "load", "F", (f"a_{i}",)) for i in AXES),
    ("stiffness", "elastic", "K_s", ()),
    ("tension_origin", "geometric", "K_g", ("P_0",)),
    ("tension_acceleration", "geometric", "K_g", ("a_x",)),
    *((f"tension_spin_{i}{i}", "geometric", "K_g", _omega(i, i)) for i in "yz"),
    ("viscous", "damping", "", ()),
)
"""Affine form of every spatial element: name, group, kernel, factors of the scalar, as ``ELEMENT_TERMS``."""

SPATIAL_BEAMS = {
    "spatial_beam_euler_bernoulli": {"shear": False, "varying": False},
    "spatial_beam_euler_bernoulli_varying": {"shear": False, "varying": True},
    "spatial_beam_timoshenko": {"shear": True, "varying": True},
}
"""Module of an element in ``kaneflex.generated`` -> the element that it is printed from. A Rayleigh beam uses the
element with shear, with phi_y and phi_z = 0."""


def spatial_beam_module(rotary: bool, shear: bool, varying: bool) -> str:
    """Smallest of SPATIAL_BEAMS that has all of this."""
    return "spatial_beam_timoshenko" if rotary or shear else f"spatial_beam_euler_bernoulli{'_varying' * varying}"
