"""Mechanisms with flexible links, from a scene file to numba kernels, by Kane's equations."""
