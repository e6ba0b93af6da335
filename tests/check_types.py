"""mypy on the package, against what is left to mend in each room; and on a user's ten lines, which must be clean.

Run by ``make lint``. A room that has more complaints than its baseline fails; one that has fewer says so, and its
baseline is lowered here.
"""

import subprocess
import sys
from collections import Counter
from pathlib import Path
from tempfile import TemporaryDirectory

ROOT = Path(__file__).parents[1]
BASELINE = {
    "cli": 1,
    "fem": 12,
    "integrate": 10,
    "mechanism": 1,
    "multibody": 25,
    "plots": 29,
    "report": 5,
    "response": 18,
    "scene": 56,
    "solve": 18,
    "study": 33,
    "support": 2,
}
"""Complaints of mypy left in each room, by the settings of pyproject.toml."""


def complaints(*arguments: str, folder: Path = ROOT) -> list[str]:
    """Lines of mypy that name an error. Raises RuntimeError where mypy itself fails."""
    found = subprocess.run([sys.executable, "-m", "mypy", *arguments], cwd=folder, capture_output=True, text=True)
    if found.returncode > 1 or found.stderr:  # not installed, for one: that is no clean bill
        raise RuntimeError(found.stdout + found.stderr)
    return [line for line in found.stdout.splitlines() if ": error: " in line]


def main() -> int:
    lines = complaints("src/kaneflex")
    counts = Counter(Path(line.split(":")[0]).parts[2] for line in lines)
    worse = {room: count for room, count in counts.items() if count > BASELINE.get(room, 0)}
    for room in worse:
        print(f"{room}: {counts[room]} complaints of mypy, {BASELINE.get(room, 0)} before:")
        print("\n".join(line for line in lines if Path(line.split(":")[0]).parts[2] == room))
    fewer = {room: counts[room] for room, count in BASELINE.items() if counts[room] < count}
    if fewer:
        print(f"fewer complaints of mypy than the baseline: lower it in {Path(__file__).name} to {fewer}")
    with TemporaryDirectory() as elsewhere:  # as a user's, which knows the package by its installation alone
        cache = f"--cache-dir={ROOT / '.build/mypy-client'}"
        client = complaints("--strict", cache, str(ROOT / "tests/typed_client.py"), folder=Path(elsewhere))
    print("\n".join(client), end="\n" if client else "")
    print(f"mypy: {sum(counts.values())} complaints left in {len(counts)} rooms, {len(client)} in a user's file")
    return 1 if worse or client else 0


if __name__ == "__main__":
    sys.exit(main())
