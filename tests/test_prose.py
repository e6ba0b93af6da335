"""README and pages keep to docs/style.md: no phrase of its table's first column, no sentence longer than it allows."""

import re
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]
STYLE = (ROOT / "docs" / "style.md").read_text(encoding="utf-8")
LONGEST = int(re.search(r"no sentence of more than (\d+) words", STYLE)[1])
PHRASES = [phrase.strip() for row in re.findall(r"^\| ([^|]+) \| [^|]+ \|$", STYLE, re.MULTILINE)[1:]
           for phrase in row.split(",") if phrase.strip("- ")]  # fmt: skip
GENERATED = {"benchmarks.md", "summary.md", "changes.md"}
"""Pages whose text stands elsewhere: with the code that measures or describes."""
PAGES = [ROOT / "README.md", ROOT / "CONTRIBUTING.md", *sorted((ROOT / "docs").rglob("*.md"))]
CHECKED = [page for page in PAGES if page.name not in GENERATED | {"style.md"}]


def prose(page: Path) -> str:
    """A page without code, formulas, tables, pictures and the targets of links; words in code become one word."""
    text = page.read_text(encoding="utf-8")
    text = re.sub(r"^```.*?^```$", "", text, flags=re.DOTALL | re.MULTILINE)
    text = re.sub(r"^\$\$.*?\$\$$", "", text, flags=re.DOTALL | re.MULTILINE)
    text = re.sub(r"^(\||#|!\[|    ).*$", "", text, flags=re.MULTILINE)
    text = re.sub(r"\]\([^)]*\)", "]", text)
    return re.sub(r"`[^`]*`|\$[^$]*\$", "X", text)


def sentences(text: str) -> list[str]:
    paragraphs = re.split(r"\n\s*\n|\n(?=\s*(?:- |\d+\. ))", text)
    return [part for each in paragraphs for part in re.split(r"(?<=[.!?:;])\s+", " ".join(each.split()))]


@pytest.mark.parametrize("page", CHECKED, ids=lambda page: page.stem)
def test_the_page_is_plain_english(page):
    text = prose(page)
    words = " ".join(text.split())
    found = [phrase for phrase in PHRASES if re.search(rf"\b{re.escape(phrase)}\b", words, re.IGNORECASE)]
    assert not found, "docs/style.md says what to write instead"
    long = [each for each in sentences(text) if len(re.findall(r"\w[\w'-]*", each)) > LONGEST]
    assert not long


def test_the_check_sees_phrases_and_long_sentences_but_no_code(tmp_path):
    page = tmp_path / "page.md"
    long = "word " * (LONGEST + 1)
    page.write_text(f"Every sensor has\na plus-minus.\n\n`plus-minus`\n\n{long}. Short.\n\n| plus-minus |\n")
    assert prose(page).count("plus-minus") == 1 and "plus-minus" in PHRASES
    assert max(len(each.split()) for each in sentences(prose(page))) > LONGEST
