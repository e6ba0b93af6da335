"""Compiled dynamics: kinematics, forces, articulated factors, loop closure. No Python objects."""
