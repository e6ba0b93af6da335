"""Rigid mechanism: bodies and joints, position analysis, closure, rigid motion."""
