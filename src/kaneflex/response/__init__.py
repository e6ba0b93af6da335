"""From a motion to what is asked of it: sensors, section forces, reactions, buckling, frequencies."""
