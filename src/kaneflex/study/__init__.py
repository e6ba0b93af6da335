"""Many models of one scene, and the questions put to them.

A model is a :class:`kaneflex.solve.variants.Variant`: settings over the scene. What
they have in common is computed once where only what they show counts (`kaneflex.solve.variants`), and each of them is
run whole where what it takes counts, too (`runs`).

Sweeps: `study` reads the file, `points` says where, `records` what is kept of a point, `store` keeps what is finished,
`sweep` goes through them in this process, in processes of this machine or in those of a Dask cluster, `dataset` labels
the results. `comparison` puts models side by side, `trade` ranks them by error and time; `differences` says how far two
are apart. `sensitivity` reads slopes from neighbours.
"""
