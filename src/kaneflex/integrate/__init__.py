"""Integrators of M(t) z'' + C(t) z' + K(t) z = F(t), reading a table of the motion's scalars.

run, together       integrate one system; several of them side by side
methods, outcome    which methods there are; how a run ended
system              what is integrated, and how the loops read it; `abreast`: one in each lane; `sliced`: long chains
feed, stretches     the table, in pieces; a cycle in eight stretches side by side
stepping, periodic  drive the loops over a run, and to the motion that repeats itself
steppers            the compiled loops; `small` and `chains` where Newmark's steps go faster
lanes               eight numbers in a register; `matrices` and `inverse` are compiled parts made of them
modal, crosscheck   decoupled modes exactly; scipy's solve_ivp

Import from these modules: a list of the methods needs no numba.
"""
