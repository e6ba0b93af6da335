"""Integrators of M(t) z'' + C(t) z' + K(t) z = F(t), reading a table of the motion's scalars.

run                       integration of a system by a method.
system, methods           equations of a system, input and outcome of a run; available methods.
by_steps, stepping        steps of equal length; loops over the steps of a run.
steppers, conventions     compiled loops over steps; constants that they share with Python.
streams                   table of the motion's scalars, in pieces.
periodic, gmres           search for the periodic motion by steps.
spectral, grid            periodic motion by harmonics, without steps; equations at the instants of a cycle.
modal                     exact solution of decoupled modes.

Import from these modules; this one imports nothing, since a list of the methods needs no numba.
"""
