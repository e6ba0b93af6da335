"""Integrators of M(t) z'' + C(t) z' + K(t) z = F(t), reading a table of the motion's scalars.

`system` says what is integrated, `methods` which methods there are, `run` integrates, `outcome` says how it
ended. Import from these modules: only `run` needs numba, so that a list of the methods costs nothing.
"""
