"""Numbers into text and JSON."""
