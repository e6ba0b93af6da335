"""C functions beside the mathematics of the standard library: the texts of ``emit``'s lookups and laws."""

from __future__ import annotations

from kaneflex.derive.lookups_numba import TABLES

_PLACE = """/* Distance from the breakpoint before x, and where the cubic there begins: p[start] intervals,
 * p[start + 1] the period (0 if none), breakpoints, coefficients. */
static double place_in_table(double x, const double p[], size_t start, size_t *cubic)
{
    const size_t n = (size_t)p[start], knots = start + 2;
    const double period = p[start + 1];
    size_t low = 0, high = n;
    if (period > 0.0) {
        double past = fmod(x - p[knots], period);
        if (past < 0.0)
            past += period;
        x = p[knots] + past;
    }
    while (high - low > 1) {
        const size_t middle = (low + high) / 2;
        if (p[knots + middle] <= x)
            low = middle;
        else
            high = middle;
    }
    *cubic = knots + n + 1 + 4 * low;
    return x - p[knots + low];
}
"""
_TABLE = """/* {doc}. */
static double {name}(double x, const double p[], size_t start)
{{
    size_t k;
    const double d = place_in_table(x, p, start, &k);
    return {value};
}}
"""
TABLE_TEXTS = {"place_in_table": _PLACE} | {
    name: _TABLE.format(name=name, doc=doc, value=value if "d *" in value else f"(void)d, {value}")
    for name, (doc, value) in TABLES.items()
}
"""Name of a lookup -> its text, after what all of them call."""

_LAW = """/* {doc} */
static double {name}({arguments})
{{
{code}
}}
"""
LAW_TEXTS = {
    name: _LAW.format(
        name=name, arguments=", ".join(f"double {each}" for each in arguments.split()), doc=doc,
        code="\n".join(f"    {line}" for line in code.split("\n")),
    )
    for name, arguments, doc, code in (
        ("sign", "x", "-1 below zero, 1 above, 0 at it.", "return x > 0.0 ? 1.0 : (x < 0.0 ? -1.0 : x);"),
        ("smaller", "a b", "The smaller of two numbers.", "return a <= b || isnan(a) ? a : b;"),
        ("larger", "a b", "The larger of two numbers.", "return a >= b || isnan(a) ? a : b;"),
        ("clamped", "s", "A number, or the end of [0, 1] beyond which it is.",
         "return smaller(larger(s, 0.0), 1.0);"),
        ("within", "s", "The slope of clamped.", "return 0.0 < s && s < 1.0 ? 1.0 : 0.0;"),
        ("chosen", "side a b", "The first, below zero the second.", "return side < 0.0 ? b : a;"),
        ("around", "side y x", "The angle of (x, y), on this side of y across its cut: beyond pi, or -pi.",
         "const double angle = atan2(y, x);\n"
         "return x < 0.0 && side * angle < 0.0 ? angle + side * 6.283185307179586 : angle;"),
    )
}  # fmt: skip
"""Name of a function of laws -> its text."""
