"""Intermediate form between symbols and text: programs of scalar assignments, their record, names and functions."""
