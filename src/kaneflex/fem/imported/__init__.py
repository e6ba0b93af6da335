"""Bodies from finite elements of other programs: files, shapes, modal data, section forces and stresses."""
