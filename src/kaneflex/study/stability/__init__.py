"""Stability of the periodic equations M z'' + C z' + K z = F: Floquet's theory, buckling, steps."""
