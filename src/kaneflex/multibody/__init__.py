"""Multibody models: bodies and joints bound to generated kernels, and the coupled nonlinear equations."""
