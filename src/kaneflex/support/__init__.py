"""Foundations of all packages: errors, units, files, caches, the terminal, and the contract of generated modules."""
