"""Symbols of spatial beam elements, by their names in the contract."""

from sympy import Symbol, symbols

from kaneflex.support.spatial_contract import SPATIAL_LINK_SCALARS, spatial_element_parameters

SCALARS = symbols([name for name, *_ in SPATIAL_LINK_SCALARS], real=True)
omega, epsilon, a, P_0 = SCALARS[:3], SCALARS[3:6], SCALARS[6:9], SCALARS[9]
MOTION = tuple(SCALARS[:9])

PARAMETERS = {
    name: Symbol(name, real=True) if name.endswith("_rise") or name in ("m_0", "S_0") else Symbol(name, positive=True)
    for name, *_ in spatial_element_parameters(shear=True, varying=True)
}
"""Every element parameter's symbol."""

rho_A, rho_I_y, rho_I_z = (PARAMETERS[name] for name in ("rho_A", "rho_I_y", "rho_I_z"))
length, x_0 = PARAMETERS["length"], PARAMETERS["x_0"]
