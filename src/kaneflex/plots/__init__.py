"""Pictures of a solution: one module for each kind, written as PNG and SVG."""
