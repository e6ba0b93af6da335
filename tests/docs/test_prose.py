"""README and pages keep to CONTRIBUTING.md: no banned phrase, no sentence longer than it allows."""

import re
from pathlib import Path

import pytest
from check_prose import LONGEST, PHRASES, ROOT, STYLE, findings, long_sentences, phrases, sentences
from places import DOCS

PAGES = [ROOT / "README.md", ROOT / "CONTRIBUTING.md", ROOT / "CHANGELOG.md", *sorted((DOCS).rglob("*.md"))]
AVOIDED = re.findall(r"`([^`]+)`", re.search(r"Pages also avoid: (.*?)\.\n", STYLE, re.DOTALL)[1])


def prose(page: Path) -> str:
    """A page without code, formulas, tables, pictures and the targets of links; words in code become one word."""
    text = page.read_text(encoding="utf-8")
    text = re.sub(r"^```.*?^```$", "", text, flags=re.DOTALL | re.MULTILINE)
    text = re.sub(r"^\$\$.*?\$\$$", "", text, flags=re.DOTALL | re.MULTILINE)
    text = re.sub(r"^(\||#|!\[|    ).*$", "", text, flags=re.MULTILINE)
    text = re.sub(r"\]\([^)]*\)", "]", text)
    return re.sub(r"`[^`]*`|\$[^$]*\$", "X", text)


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.stem)
def test_the_page_is_plain_english(page):
    text = prose(page)
    words = " ".join(text.split())
    avoided = [phrase for phrase in AVOIDED if re.search(rf"\b{phrase}\b", words, re.IGNORECASE)]
    assert not phrases(text) + avoided, "CONTRIBUTING.md says what to write instead"
    assert not long_sentences(text)


def test_the_check_sees_phrases_and_long_sentences_but_no_code(tmp_path):
    page = tmp_path / "page.md"
    long = "word " * (LONGEST + 1)
    page.write_text(f"Every sensor has\na plus-minus.\n\n`plus-minus`\n\n{long}. Short.\n\n| plus-minus |\n")
    assert prose(page).count("plus-minus") == 1 and "plus-minus" in PHRASES
    assert max(len(each.split()) for each in sentences(prose(page))) > LONGEST


def test_the_check_sees_docstrings_messages_and_help_but_no_code():
    long = "word " * (LONGEST + 1)
    source = f"""'''What this module is for.'''
total = 1
'''Sum of a plus-minus.'''
def solve(plus_minus):
    raise ValueError(f"{{plus_minus}} has no plus-minus `plus-minus`")
option("--x", help="{long}")
"""
    assert [line for line, _ in findings(source)] == [1, 3, 5, 6]
