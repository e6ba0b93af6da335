"""Constants that compiled loops share with the Python that calls them; numba is not imported here."""

# No "nnan", "ninf": the test for a runaway motion relies on comparisons with NaN being false.
FASTMATH = {"nsz", "arcp", "contract", "afn", "reassoc"}
COMPLETED, SINGULAR, UNBOUNDED = 0, 1, 2
"""Outcomes of a loop over steps."""
