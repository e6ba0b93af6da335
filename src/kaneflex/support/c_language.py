"""Reserved names and headers of generated C."""

from __future__ import annotations

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
