"""Evaluation of a motion: sensors, section forces, reactions, buckling, frequencies."""
