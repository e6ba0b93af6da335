"""Elastic links: finite elements, coordinates, joints' releases, reduction, modes."""
