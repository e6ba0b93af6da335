"""Text of a user, like a scene's name, as a comment or a literal of each language that it is written into.

A name may hold anything. Whatever it is, it stays one comment or one literal, and what is not printable is seen:
control characters, which terminals obey and XML forbids, and directions of writing, which show source in another order
than it is compiled in (Boucher and Anderson 2021, "Trojan Source").
"""

from __future__ import annotations

import re
import textwrap
import unicodedata
from html import escape

_JOINERS = "\N{ZERO WIDTH NON-JOINER}\N{ZERO WIDTH JOINER}"
"""Part of words in Persian and in Indian languages, and of emoji."""
_BOLD = re.compile("(\x1b\\[1m|\x1b\\[0m)")
"""The escape sequences that our own tables have: bold, and its end."""
_LATEX = {
    "\\": r"\textbackslash{}", "~": r"\textasciitilde{}", "^": r"\textasciicircum{}",
    "<": r"\ensuremath{<}", ">": r"\ensuremath{>}", "|": r"\ensuremath{|}",  # plain fonts have others in their places
}  # fmt: skip
_LONGEST_IN_PICTURE = 300
"""Characters: the title sets the width of a drawing, which has to stay below 2^16 pixels."""
_LAST_OF_LATEX = "\u017f"
"""The last letter of Latin Extended-A: beyond it plain LaTeX has no letters without a package."""


def visible(text: str, keep: str = "") -> str:
    """Text with every character that is not printable written like <U+001B>, but those to ``keep``."""
    return text if text.isprintable() else "".join(map(lambda letter: _seen(letter, keep), text))


def _seen(letter: str, keep: str) -> str:
    fine = letter.isprintable() or letter in keep or letter in _JOINERS or unicodedata.category(letter) == "Zs"
    return letter if fine else f"<U+{ord(letter):04X}>"


def terminal(text: str, encoding: str | None = None) -> str:
    """Text for a terminal, which obeys nothing in it but bold, in letters that an encoding has."""
    parts = _BOLD.split(text)
    shown = "".join(part if k % 2 else visible(part, "\n\t") for k, part in enumerate(parts))
    return shown.encode(encoding or "utf-8", "backslashreplace").decode(encoding or "utf-8")


def c_comment(text: str) -> str:
    """A comment of C, in lines of at most 118 letters."""
    parts = (textwrap.wrap(c_inline(line), 116, drop_whitespace=False) or [""] for line in text.splitlines() or [""])
    lines = [line for part in parts for line in part]
    return "\n".join(f"{' *' if k else '/*'} {line}".rstrip() for k, line in enumerate(lines)) + " */"


def c_inline(text: str) -> str:
    """Text within a line of a comment of C: nothing begins or ends one in it, or is a trigraph (C11, 5.2.1.1)."""
    shown = visible(text).replace("\\", "/")
    return re.sub(r"(?<=\*)(?=/)|(?<=/)(?=\*)|(?<=\?)(?=\?)", " ", shown)


def c_literal(text: str) -> str:
    """A text in C's quotes; its bytes of UTF-8 that are not plain in octal. Question marks could begin a trigraph."""
    inside = (chr(byte) if _plain_in_c(byte) else f"\\{byte:03o}" for byte in text.encode("utf-8", "replace"))
    return f'"{"".join(inside)}"'


def _plain_in_c(byte: int) -> bool:
    return 0x20 <= byte < 0x7F and chr(byte) not in '\\"?'


def xml(text: str) -> str:
    """Text of XML, from which whoever writes the file has yet to escape &, < and quotes."""
    return visible(text)


def xml_comment(text: str) -> str:
    """A comment of XML, which has no two hyphens beside each other in it (XML 1.0, production 15)."""
    return f"<!-- {re.sub('-(?=-)', '- ', visible(text))} -->"


def html(text: str) -> str:
    """Text of HTML, of elements and of attributes in quotes."""
    return escape(visible(text, "\n\t"))


def script_data(json: str) -> str:
    """JSON within an element <script> of HTML, which nothing in it ends."""
    return json.replace("<", "\\u003c").replace(">", "\\u003e")


def latex(text: str) -> str:
    """Text of LaTeX in one paragraph, as it stands."""
    shown = "".join(c if c <= _LAST_OF_LATEX else f"<U+{ord(c):04X}>" for c in visible(text))
    return re.sub(r"[\\~^#$%&_{}<>|]", lambda match: _LATEX.get(match[0], f"\\{match[0]}"), shown)


def modelica_string(text: str) -> str:
    """A text in Modelica's quotes (Modelica Language Specification 3.6, section 2.4.6)."""
    return f'"{_modelica(text, chr(34))}"'


def modelica_name(text: str) -> str:
    """A name in quotes, as Modelica writes what is no identifier (ibid., section 2.3.1)."""
    return f"'{_modelica(text, chr(39))}'"


def _modelica(text: str, quote: str) -> str:
    return visible(text).replace("\\", "\\\\").replace(quote, f"\\{quote}")


def picture_text(text: str) -> str:
    """Text of a picture by matplotlib, which takes what stands between two dollars for mathematics."""
    shown = text if len(text) <= _LONGEST_IN_PICTURE else f"{text[:_LONGEST_IN_PICTURE]}..."
    return visible(shown, "\n").replace("$", r"\$")
