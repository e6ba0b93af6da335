"""The mechanism before anything deforms: bodies and joints, position analysis, closure, the rigid motion."""
