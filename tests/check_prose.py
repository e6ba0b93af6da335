"""Prose check by CONTRIBUTING.md: pages (tests/docs/test_prose.py), docstrings, messages and help texts of the sources.

Run by ``make lint``. A package with more findings than its baseline fails; one with fewer asks to lower its baseline
here. With names of packages as arguments, print their findings.
"""

import ast
import re
import sys
from collections import Counter
from pathlib import Path

ROOT = Path(__file__).parents[1]
STYLE = (ROOT / "CONTRIBUTING.md").read_text(encoding="utf-8")
LONGEST = int(re.search(r"no sentence of more than (\d+) words", STYLE)[1])
PHRASES = [phrase.strip() for row in re.findall(r"^\| ([^|]+) \| [^|]+ \|$", STYLE, re.MULTILINE)[1:]
           for phrase in row.split(",") if phrase.strip("- ")]  # fmt: skip
OPENERS = ("What", "Where", "Whose", "Of", "How", "Whether", "Which", "Those")
"""First words that hide the noun or verb of a docstring."""
BASELINE = {"export": 1}
"""Findings left in each package; a package that is not named has none."""


def sentences(text: str) -> list[str]:
    paragraphs = re.split(r"\n\s*\n|\n(?=\s*(?:- |\d+\. ))", text)
    return [part for each in paragraphs for part in re.split(r"(?<=[.!?:;])\s+", " ".join(each.split()))]


def phrases(text: str) -> list[str]:
    """Banned phrases in a text."""
    words = " ".join(text.split())
    return [phrase for phrase in PHRASES if re.search(rf"\b{re.escape(phrase)}\b", words, re.IGNORECASE)]


def long_sentences(text: str) -> list[str]:
    return [each for each in sentences(text) if len(re.findall(r"\w[\w'-]*", each)) > LONGEST]


def texts(tree: ast.AST) -> list[tuple[int, str, bool]]:
    """Line, text and whether it is a docstring, of each string of three words or more; values in a message become X.

    Texts that begin with a line break or have more than five are templates and lists of words, and are left out.
    """
    found, inside = [], set()
    for node in ast.walk(tree):
        if isinstance(node, ast.Expr) and isinstance(node.value, ast.Constant) and isinstance(node.value.value, str):
            found.append((node.lineno, node.value.value, True))
            inside.add(node.value)
        elif isinstance(node, ast.JoinedStr):
            parts = [part.value if isinstance(part, ast.Constant) else "X" for part in node.values]
            found.append((node.lineno, "".join(parts), False))
            inside |= set(node.values)
        elif isinstance(node, ast.Constant) and isinstance(node.value, str) and node not in inside:
            found.append((node.lineno, node.value, False))
    plain = (each for each in found if each[2] or (not each[1].startswith("\n") and each[1].count("\n") < 6))
    return [each for each in plain if len(each[1].split()) > 2]


def findings(source: str) -> list[tuple[int, str]]:
    """Line and complaint of each finding in a module."""
    found = []
    for line, text, is_docstring in texts(ast.parse(source)):
        plain = re.sub(r"`[^`]*`|https?:\S+", "X", text)
        found += [(line, f"banned: {phrase}") for phrase in phrases(plain)]
        found += [(line, f"more than {LONGEST} words: {each[:60]} ...") for each in long_sentences(plain)]
        if is_docstring and text.split()[0].strip(",:") in OPENERS:
            found.append((line, f"opens with {text.split()[0]}: {' '.join(text.split())[:60]}"))
    return sorted(found)


def package(path: Path) -> str:
    parts = path.relative_to(ROOT).parts
    return "derive" if parts[0] == "derive" else parts[2] if len(parts) > 3 else "kaneflex"


def main() -> int:
    files = [path for folder in ("src", "derive") for path in sorted((ROOT / folder).rglob("*.py"))]
    found = [(package(path), f"{path.relative_to(ROOT)}:{line}: {complaint}")
             for path in files for line, complaint in findings(path.read_text(encoding="utf-8"))]  # fmt: skip
    counts = Counter(name for name, _ in found)
    worse = {name for name, count in counts.items() if count > BASELINE.get(name, 0)}
    for name, text in found:
        if name in worse or name in sys.argv[1:]:
            print(text)
    fewer = {name: counts[name] for name, count in BASELINE.items() if counts[name] < count}
    if fewer:
        print(f"fewer findings than the baseline: lower it in {Path(__file__).name} to {fewer}")
    print(f"prose: {sum(counts.values())} findings left in {len(counts)} packages; CONTRIBUTING.md says how to write")
    return 1 if worse else 0


if __name__ == "__main__":
    sys.exit(main())
