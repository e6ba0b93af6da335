"""Parameters, motion scalars and terms of the elements: names, units, meanings and order in generated modules."""

from itertools import combinations_with_replacement

from kaneflex.support.contract import AXES

LINK_SCALARS = (
    ("omega", "rad/s", "angular velocity of the link frame"),
    ("epsilon", "rad/s^2", "angular acceleration of the link frame"),
    ("a_x", "m/s^2", "acceleration of the link's origin minus gravity, along the link"),
    ("a_y", "m/s^2", "acceleration of the link's origin minus gravity, across the link"),
    ("P_0", "N", "axial force at the link's origin, tension positive"),
)
"""Motion scalars of one elastic link, in the order in which every element kernel reads its argument ``s``."""

BODY_SCALARS = {
    "x": ("m", "global x of the body's start"),
    "y": ("m", "global y of the body's start"),
    "c": ("1", "cosine of the body's angle"),
    "s": ("1", "sine of the body's angle"),
    "v_x": ("m/s", "velocity of the body's start, global x"),
    "v_y": ("m/s", "velocity of the body's start, global y"),
    "omega": ("rad/s", "angular velocity of the body"),
    "a_x": ("m/s^2", "acceleration of the body's start, global x"),
    "a_y": ("m/s^2", "acceleration of the body's start, global y"),
    "epsilon": ("rad/s^2", "angular acceleration of the body"),
}
"""Motion scalars of one body with unit and meaning, in their order in a module's SCALARS."""

ELEMENT_PARAMETERS = (
    ("rho_A", "kg/m", "mass per length"),
    ("E_A", "N", "axial stiffness"),
    ("E_I", "N m^2", "bending stiffness"),
    ("length", "m", "length of the element"),
    ("x_0", "m", "distance of the element's first node from the link's origin"),
)
"""Parameters of one uniform Euler-Bernoulli element, in the order in which every element kernel reads its ``p``."""

ROTARY_PARAMETERS = (("rho_I", "kg m", "rotary inertia per length"),)
"""Parameters added if a link of the scene is a Rayleigh or a Timoshenko beam."""

SHEAR_PARAMETERS = (("phi_s", "1", "flexibility in shear against bending, 12 E I / (kappa G A length^2)"),)
"""Parameters added if a link is a Timoshenko beam."""

VARYING_PARAMETERS = (
    ("rho_A_rise", "kg/m", "growth of rho_A over the element, of which rho_A is then the mean"),
    ("E_A_rise", "N", "growth of E_A over the element"),
    ("E_I_rise", "N m^2", "growth of E_I over the element"),
    ("m_0", "kg", "mass of the link before the element"),
    ("S_0", "kg m", "first moment of that mass about the link's origin"),
)
"""Parameters added to ELEMENT_PARAMETERS if a section varies along a link."""

VARYING_ROTARY_PARAMETERS = (("rho_I_rise", "kg m", "growth of rho_I over the element"),)
"""Parameters added to ROTARY_PARAMETERS if a section varies along a link."""


def element_parameters(rotary: bool, shear: bool, varying: bool) -> tuple[tuple[str, str, str], ...]:
    """Name, unit and meaning of a module's element parameters, as the scene's links require."""
    found = ELEMENT_PARAMETERS + VARYING_PARAMETERS * varying + ROTARY_PARAMETERS * rotary
    return found + VARYING_ROTARY_PARAMETERS * (varying and rotary) + SHEAR_PARAMETERS * shear


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
_GENERAL = (
    *((f"{name}_rise", unit, f"growth of {name} over the element") for name, unit, _ in _DENSITIES + _RIGIDITIES),
    ("m_0", "kg", "mass of the link before the element"),
    ("S_0", "kg m", "first moment of that mass about the link's origin"),
    ("rotary", "1", "1 if sections have rotary inertia against bending, too, else 0"),
    ("phi_y", "1", "flexibility in shear along y, 12 E I_z / (k_y G A length^2)"),
    ("phi_z", "1", "flexibility in shear along z, 12 E I_y / (k_z G A length^2)"),
)


def spatial_element_parameters(general: bool) -> tuple[tuple[str, str, str], ...]:
    """Name, unit and meaning of an element's parameters, in the order in which its kernels read them.

    In the general element, parameters with a growth are means over the element.
    """
    return _DENSITIES + _RIGIDITIES + _UNIFORM + _GENERAL * general


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
"""Terms of every spatial element's affine form: name, group, kernel that contains the term, factors of the scalar
before its constant matrix. A structure's module names those that it requires. The damping mu int N^T N dx has no kernel
of its own: it is the M of translation in K_d, with mu for rho A."""

_OUT_OF_PLANE = {"omega_x", "omega_y", "epsilon_x", "epsilon_y", "a_z"}
ELEMENT_TERMS = tuple(
    (name.removesuffix("_zz").removesuffix("_z"), group, kernel, tuple(each.removesuffix("_z") for each in factors))
    for name, group, kernel, factors in SPATIAL_ELEMENT_TERMS
    if not _OUT_OF_PLANE & {*factors}
)
"""Terms of every planar element, which turns about z alone."""

BEAMS = {
    "beam_euler_bernoulli": {"rotary": False, "shear": False, "varying": False},
    "beam_timoshenko": {"rotary": True, "shear": True, "varying": True},
}
"""Module of a planar element in ``kaneflex.generated`` -> the element that it is printed from. The general one also
serves Rayleigh beams, with phi_s = 0, and tapered Euler-Bernoulli beams, with rho_I = 0 besides."""

SPATIAL_BEAMS = {f"spatial_{module}": options["varying"] for module, options in BEAMS.items()}
"""Module of an element in space -> whether it is the general one, which has all that some beam requires."""
