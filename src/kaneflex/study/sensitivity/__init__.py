"""Derivatives of a run's sensors with respect to numbers of its scene."""
