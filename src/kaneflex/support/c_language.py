"""What every text in C minds: words that are taken, comments that nothing ends early."""

from __future__ import annotations

import textwrap

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
"""What nothing of ours may be called in C."""


def comment(text: str) -> str:
    """A comment of C, in lines of at most 118 letters; what would end it is pulled apart."""
    safe = plain(text)
    lines = [part for line in safe.splitlines() for part in (textwrap.wrap(line, 116, drop_whitespace=False) or [""])]
    return "\n".join(f"{' *' if k else '/*'} {line}".rstrip() for k, line in enumerate(lines)) + " */"


def plain(text: str) -> str:
    """Text that can stand in a comment of C: nothing begins or ends one in it."""
    return text.replace("*/", "* /").replace("/*", "/ *").replace("\\", "/")
