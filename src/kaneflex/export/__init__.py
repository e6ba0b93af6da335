"""Export of models: C, one readable Python file, functional mock-up units (FMU), LaTeX."""
