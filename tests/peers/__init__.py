"""Other programs with formulations of their own, to compare results of the same scenes: ``compare --with exudyn``."""
