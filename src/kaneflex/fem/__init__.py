"""Elastic links: finite elements, coordinates, releases at joints, reduction, modes."""
