"""One self-contained numba module for each shipped scene; written by `make derive`, never by hand."""
