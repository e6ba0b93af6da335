"""Compilation: values, addresses and libraries of compiled functions."""
