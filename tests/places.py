"""Folders that tests read."""

from pathlib import Path

ROOT = Path(__file__).parents[1]
DATA, DOCS = ROOT / "tests" / "data", ROOT / "docs"
