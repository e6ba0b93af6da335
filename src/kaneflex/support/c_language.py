"""Reserved names, headers, comments and literals of generated C."""

from __future__ import annotations

import re
import textwrap

from kaneflex.support.escaping import visible

_MATHEMATICS = """
    acos acosh asin asinh atan atan2 atanh cbrt ceil copysign cos cosh erf erfc exp exp2 expm1 fabs fdim floor fma fmax
    fmin fmod frexp hypot ilogb ldexp lgamma llrint llround log log10 log1p log2 logb lrint lround modf nan nearbyint
    nextafter nexttoward pow remainder remquo rint round scalbln scalbn sin sinh sqrt tan tanh tgamma trunc
    NAN INFINITY HUGE_VAL NULL size_t
"""
_KEYWORDS = """
    auto break case char const continue default do double else enum extern float for goto if inline int long register
    restrict return short signed sizeof static struct switch typedef union unsigned void volatile while
"""
RESERVED = (*_MATHEMATICS.split(), *_KEYWORDS.split())
"""Names that no identifier in generated C may have."""


def header_text(name: str, about: str, body: str, includes: str = "") -> str:
    """Header NAME.h: a comment, included headers, and declarations for C and C++."""
    return _HEADER.format(guard=f"{name.upper()}_H", about=about, body=body.rstrip("\n"), includes=includes)


_HEADER = """{about}
#ifndef {guard}
#define {guard}

{includes}#ifdef __cplusplus
extern "C" {{
#endif

{body}

#ifdef __cplusplus
}}
#endif

#endif
"""


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
