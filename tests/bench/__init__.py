"""Benchmarks: ``make bench`` times everything and writes ``docs/benchmarks.md``; ``make bench-quick`` checks ratios.

    interleave      the one timer: candidates in turn, medians with their quartiles
    rows            what is measured: rows of a table, and the targets
    tasks           the two tasks of the kernels, in symbols and in numbers
    compiled        C to a shared library
    peers, casadi_peers   the tasks by kaneflex, hand-written C, lambdify, PyDy, CasADi
    latency, kernels, exudyn_runs, ivp_runs, scaling, sweeps   the sections: each yields its rows
    cycles          rows of the sweeps: cycles by steps and by harmonics
    quick           loose ratios of the kernels, for CI
    machine, picture, report   rows to docs/benchmarks.json, .md and a picture
"""
