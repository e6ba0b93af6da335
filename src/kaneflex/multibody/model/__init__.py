"""Models: topology, typed arrays, shapes, initial state, determinacy of a mechanism."""
