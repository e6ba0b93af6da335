"""Beam elements in the plane and in space: shape functions, Kane's equations of a slice, kernels of one element."""
