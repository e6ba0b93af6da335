"""Escaping of a user's texts, like a scene's name, on the terminal, in HTML and in pictures; other languages' escapes
stand with their writers.

A name may contain any characters. Characters that are not printable are
made visible: control characters, which terminals obey and XML forbids, and bidirectional controls, which show source
in another order than it is compiled in (Boucher and Anderson 2021, "Trojan Source").
"""

from __future__ import annotations

import re
import unicodedata
from html import escape

_JOINERS = "\N{ZERO WIDTH NON-JOINER}\N{ZERO WIDTH JOINER}"
"""Zero-width joiners: part of words in Persian and in Indian languages, and of emoji."""
_BOLD = re.compile("(\x1b\\[1m|\x1b\\[0m)")
"""Escape sequences of kaneflex's tables: bold, and its end."""
_LONGEST_IN_PICTURE = 300
"""Largest number of characters: the title sets the width of a drawing, which must stay below 2^16 pixels."""


def visible(text: str, keep: str = "") -> str:
    """Text with characters that are not printable written like <U+001B>, except those to ``keep``."""
    return text if text.isprintable() else "".join(map(lambda letter: _seen(letter, keep), text))


def _seen(letter: str, keep: str) -> str:
    fine = letter.isprintable() or letter in keep or letter in _JOINERS or unicodedata.category(letter) == "Zs"
    return letter if fine else f"<U+{ord(letter):04X}>"


def terminal(text: str, encoding: str | None = None) -> str:
    """Text for a terminal: no control sequences except bold, and only letters of the encoding."""
    parts = _BOLD.split(text)
    shown = "".join(part if k % 2 else visible(part, "\n\t") for k, part in enumerate(parts))
    return shown.encode(encoding or "utf-8", "backslashreplace").decode(encoding or "utf-8")


def ascii_identifier(name: str) -> str:
    """Identifier without letters beyond ASCII, which Python would turn into their NFKC form."""
    return "".join(letter if letter.isascii() else f"u{ord(letter):x}" for letter in name)


def html(text: str) -> str:
    """Text for HTML elements and quoted attributes."""
    return escape(visible(text, "\n\t"))


def script_data(json: str) -> str:
    """JSON for an HTML element <script>, without its end tag."""
    return json.replace("<", "\\u003c").replace(">", "\\u003e")


def picture_text(text: str) -> str:
    """Text for matplotlib, with escaped dollars, which would delimit mathematics."""
    shown = text if len(text) <= _LONGEST_IN_PICTURE else f"{text[:_LONGEST_IN_PICTURE]}..."
    return visible(shown, "\n").replace("$", r"\$")
