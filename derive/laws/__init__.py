"""Joints, springs, contacts, friction, drives and loads as modules of kernels."""
