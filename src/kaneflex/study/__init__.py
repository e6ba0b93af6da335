"""Sweeps: one scene at many points of its parameters, into one labelled dataset.

`study` reads the file, `points` says where, `run` solves one point, `store` keeps what is finished, `sweep` goes
through them in this process, in processes of this machine or in those of a Dask cluster, `dataset` labels the results.
"""
