"""Integrators of M(t) z'' + C(t) z' + K(t) z = F(t), reading a table of the motion's scalars.

task, run                 input of an integration; integrate a system
by_steps, by_scipy        with steps of equal length; with steps that scipy chooses
methods, outcome          which methods there are; how a run ended
system, streams           what is integrated; its table, in pieces
stepping, periodic        drive the loops over a run, and to the motion that repeats itself
spectral, disturbances    that motion by its harmonics, without steps; whether it attracts its neighbours
instants, corrections     the compiled parts of that
fourier                   Fourier transforms of a cycle that lies in lanes
steppers                  the compiled loops
conventions               constants and arrays that the compiled loops share with Python
lanes, matrices           eight numbers in a register, and the compiled parts made of them
modal                     decoupled modes exactly

Import from these modules: a list of the methods needs no numba.
"""
