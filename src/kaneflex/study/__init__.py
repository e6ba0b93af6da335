"""Studies: runs of many models of one scene.

A model is a :class:`kaneflex.solve.variants.Variant`: settings over the scene. `kaneflex.solve.variants` computes the
common parts once; `runs` runs each model from the start, to measure its time, too.

Sweeps: `study` reads the file, `plan` numbers the points, `records` defines the result of a point, `store` keeps
finished points, `sweep` solves the others in this process or in processes of this machine. `comparison` compares
models, `trade` ranks them by error and time, `differences` measures the error between two, `sensitivity` computes
derivatives by finite differences.
"""
