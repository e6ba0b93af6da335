"""Bodies that move freely and deform by shapes: Kane's equations, kernels as loops over shapes, and their proof."""
