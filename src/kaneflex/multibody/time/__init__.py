"""Motion in time: collocation, location of events, shooting, harmonic balance, linearisation, trajectories."""
