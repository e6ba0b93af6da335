"""From a scene to its solution: load, simulate, linearise."""
