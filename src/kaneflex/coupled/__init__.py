"""Preset ``coupled`` at run time: rigid motion and deformation together.

shapes      modal coordinates of every elastic link, from its finite elements
families    functions that can stand for the modes among them
moments     the sums over a link's slices that the generated kernels take as parameters
modal_data  these sums and the shapes as arrays, for other programs
unresolved  the modes that a run's steps are too long for
stepping    the compiled integrator: Gauss-Legendre with an error-controlled step, index-1 multipliers, projection
steps       the single steps of a finished run
slopes      the compiled slopes of its steps along numbers of the scene
run         from a model to a trajectory: initial state, dense output, energy balance
motion      what sensors read: frames, deformations and reactions of a coupled trajectory
"""
