"""Escaping of a user's texts, like a scene's name, as a comment or a literal of each output language.

A name may contain any characters. It remains one comment or one literal, and characters that are not printable are
made visible: control characters, which terminals obey and XML forbids, and bidirectional controls, which show source
in another order than it is compiled in (Boucher and Anderson 2021, "Trojan Source").
"""

from __future__ import annotations

import re
import textwrap
import unicodedata
from html import escape

_JOINERS = "\N{ZERO WIDTH NON-JOINER}\N{ZERO WIDTH JOINER}"
"""Zero-width joiners: part of words in Persian and in Indian languages, and of emoji."""
_BOLD = re.compile("(\x1b\\[1m|\x1b\\[0m)")
"""Escape sequences of kaneflex's tables: bold, and its end."""
_LATEX = {
    "\\": r"\textbackslash{}", "~": r"\textasciitilde{}", "^": r"\textasciicircum{}",
    "<": r"\ensuremath{<}", ">": r"\ensuremath{>}", "|": r"\ensuremath{|}",  # plain fonts have others in their places
}  # fmt: skip
_LONGEST_IN_PICTURE = 300
"""Largest number of characters: the title sets the width of a drawing, which must stay below 2^16 pixels."""
_LAST_OF_LATEX = "\u017f"
"""Last letter of Latin Extended-A; LaTeX needs packages for letters beyond it."""


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


def c_comment(text: str) -> str:
    """C comment, in lines of at most 118 letters."""
    parts = (textwrap.wrap(c_inline(line), 116, drop_whitespace=False) or [""] for line in text.splitlines() or [""])
    lines = [line for part in parts for line in part]
    return "\n".join(f"{' *' if k else '/*'} {line}".rstrip() for k, line in enumerate(lines)) + " */"


def c_inline(text: str) -> str:
    """Text within a C comment, without its delimiters and without trigraphs (C11, 5.2.1.1)."""
    shown = visible(text).replace("\\", "/")
    return re.sub(r"(?<=\*)(?=/)|(?<=/)(?=\*)|(?<=\?)(?=\?)", " ", shown)


def c_literal(text: str) -> str:
    """C string literal; UTF-8 bytes beyond ASCII are octal. Question marks are escaped against trigraphs."""
    plain = [0x20 <= byte < 0x7F and chr(byte) not in '\\"?' for byte in range(256)]
    inside = (chr(byte) if plain[byte] else f"\\{byte:03o}" for byte in text.encode("utf-8", "replace"))
    return f'"{"".join(inside)}"'


def ascii_identifier(name: str) -> str:
    """Identifier without letters beyond ASCII, which Python would turn into their NFKC form."""
    return "".join(letter if letter.isascii() else f"u{ord(letter):x}" for letter in name)


def xml(text: str) -> str:
    """Text for XML; the writer of the file must still escape &, < and quotes."""
    return visible(text)


def xml_comment(text: str) -> str:
    """XML comment, without adjacent hyphens (XML 1.0, production 15)."""
    return f"<!-- {re.sub('-(?=-)', '- ', visible(text))} -->"


def html(text: str) -> str:
    """Text for HTML elements and quoted attributes."""
    return escape(visible(text, "\n\t"))


def script_data(json: str) -> str:
    """JSON for an HTML element <script>, without its end tag."""
    return json.replace("<", "\\u003c").replace(">", "\\u003e")


def latex(text: str) -> str:
    """Literal text of one paragraph of LaTeX."""
    shown = "".join(c if c <= _LAST_OF_LATEX else f"<U+{ord(c):04X}>" for c in visible(text))
    return re.sub(r"[\\~^#$%&_{}<>|]", lambda match: _LATEX.get(match[0], f"\\{match[0]}"), shown)


def modelica_string(text: str) -> str:
    """Modelica string literal (Modelica Language Specification 3.6, section 2.4.6)."""
    return f'"{_modelica(text, chr(34))}"'


def modelica_name(text: str) -> str:
    """Quoted Modelica identifier, for names that are not identifiers (ibid., section 2.3.1)."""
    return f"'{_modelica(text, chr(39))}'"


def _modelica(text: str, quote: str) -> str:
    return visible(text).replace("\\", "\\\\").replace(quote, f"\\{quote}")


def picture_text(text: str) -> str:
    """Text for matplotlib, with escaped dollars, which would delimit mathematics."""
    shown = text if len(text) <= _LONGEST_IN_PICTURE else f"{text[:_LONGEST_IN_PICTURE]}..."
    return visible(shown, "\n").replace("$", r"\$")
