"""Bodies and joints bound to generated kernels: the model, and the coupled nonlinear equations."""
