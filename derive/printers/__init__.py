"""Printers: programs as numba (:mod:`.numba_printer`), compiled functions as C (:mod:`.c_printer`), LaTeX.

A program is printed as numba once; the printer of C reads that text, and the engine's, which is written by hand.
"""
