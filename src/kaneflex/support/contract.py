"""Contract between the generator and the runtime: content and names of a generated module.

Parameters, scalars and terms of elements are in ``kaneflex.derive.elements.parameters``; modules of beams contain them.
"""

FORMAT = 4
"""Version of the generated modules' layout, part of the structure hash: old modules are not used with a new layout."""

COURSES = ("angle_table", "speed_table", "acceleration_table")
"""Parameters with the place in p of a free joint's motion, which the runtime integrates first."""

ELEMENT_KERNELS = ("M", "K_s", "K_d", "K_g", "C", "F")
"""Kernels of an element."""

AXES = "xyz"

SPATIAL_LINK_SCALARS = (
    *((f"omega_{axis}", "rad/s", f"angular velocity of the link frame about its {axis}") for axis in AXES),
    *((f"epsilon_{axis}", "rad/s^2", f"angular acceleration of the link frame about its {axis}") for axis in AXES),
    *((f"a_{axis}", "m/s^2", f"acceleration of the link's origin minus gravity, along its {axis}") for axis in AXES),
    ("P_0", "N", "axial force at the link's origin, tension positive"),
)
"""Motion scalars of one elastic link in space."""

SPATIAL_NODE = ("u", "v", "w", "theta_x", "theta_y", "theta_z")
"""Coordinates of a node in link axes [m, rad]: x along the link, y and z the principal axes of its sections.
theta_z = v' and theta_y = -w' if sections stay normal to the axis."""


def beam_module(rotary: bool, shear: bool, varying: bool) -> str:
    """Smallest module of an element that has all of this; its counterpart in space is ``spatial_`` and its name."""
    return "beam_timoshenko" if rotary or shear or varying else "beam_euler_bernoulli"


REQUIRED_ATTRIBUTES = (
    "FORMAT", "STRUCTURE", "PARAMETERS", "TABLES", "SCALARS", "CONSTANTS", "LINKS", "TERMS", "OPERATIONS",
    "FREE", "motion", "tabulate",
)  # fmt: skip
"""Attributes of every structure's module; with elastic links also the kernels of the terms."""

LAWS_ATTRIBUTES = (
    "FORMAT", "STRUCTURE", "PARAMETERS", "TABLES", "DRIVES", "OBSERVED", "LOADS", "OPERATIONS", "courses", "magnitudes",
)  # fmt: skip
"""Attributes of every module of drives and loads."""
