"""Integrators of M(t) z'' + C(t) z' + K(t) z = F(t), reading a table of the motion's scalars.

task, run                 input of an integration; integration of a system.
by_steps, pace            steps of equal length; work and stiffness of free joints.
methods, outcome          available methods; outcome of a run.
system, streams           equations of a system; their table, in blocks.
stepping, periodic        loops over the steps of a run; search for the periodic motion by steps.
spectral, disturbances    periodic motion by harmonics, without steps; growth of disturbances of it.
instants, corrections     compiled parts of these.
fourier                   Fourier transforms of a cycle that is stored in lanes.
steppers                  compiled loops over steps.
conventions               constants and arrays that compiled loops share with Python.
lanes                     eight numbers per register (SIMD).
modal                     exact solution of decoupled modes.

Import from these modules; this one imports nothing, since a list of the methods needs no numba.
"""
