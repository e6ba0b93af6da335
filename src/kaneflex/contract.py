"""The contract between the generator and the runtime: what a generated module holds, in which order, under which names.

Both sides import this file and nothing else of each other, so a name can't drift on one side only.
"""

FORMAT = 1
"""Version of the generated modules' layout. It enters the structure hash: a new layout never meets an old module."""

LINK_SCALARS = (
    ("omega", "rad/s", "angular velocity of the link frame"),
    ("epsilon", "rad/s^2", "angular acceleration of the link frame"),
    ("a_x", "m/s^2", "acceleration of the link's origin minus gravity, along the link"),
    ("a_y", "m/s^2", "acceleration of the link's origin minus gravity, across the link"),
    ("P_0", "N", "axial force at the link's origin, tension positive"),
)
"""Motion scalars of one elastic link, in the order in which every element kernel reads its argument ``s``."""

ELEMENT_PARAMETERS = (
    ("rho_A", "kg/m", "mass per length"),
    ("E_A", "N", "axial stiffness"),
    ("E_I", "N m^2", "bending stiffness"),
    ("length", "m", "length of the element"),
    ("x_0", "m", "distance of the element's first node from the link's origin"),
)
"""Parameters of one beam element, in the order in which every element kernel reads its argument ``p``."""

ELEMENT_KERNELS = ("M", "K_s", "K_d", "K_g", "C", "F")
"""The composed element kernels; ``motion``, ``F_t`` and ``terms`` complete the module."""

REQUIRED_ATTRIBUTES = (
    "FORMAT", "STRUCTURE", "SCENE", "PARAMETERS", "TABLES", "SCALARS", "CONSTANTS", "LINKS", "TERMS", "OPERATIONS",
    "motion", "tabulate",
)  # fmt: skip
"""Attributes of every generated module; with elastic links also ``terms`` and the kernels that the scene requires."""
