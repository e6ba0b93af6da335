"""Names that would be code, markup or commands where they are written; by what is bad about them."""

HOSTILE = {
    "comment of C": "a */ int main(void) { return 7; } /* b",
    "star and backslash": "*\\", "slash and star": "/*/ /**/ */*", "only a star": "*", "only a slash": "/",
    "trigraphs": "??/ ???/ ??' ??=define x", "trigraph before a quote": '??/" *??/\n/',
    "line continuation": "//\\\n */ *\\\n/ \\", "quotes": "\"'`\"; system(\"ls\"); \"",
    "format": "%s%n %% {0} {{data}}", "escape sequences": "\x1b[31mred\x1b]0;title\x07\x9b2J",
    "control characters": "a\0b\x08\x0c\r\x7f\x85c",
    "lines": "one\ntwo\n\nthree", "other lines": "a\u2028b\u2029c\x0bd", "script": "</script><script>alert(1)</script>",
    "double escape": "<!--<script>", "attribute": "'\" onload=\"alert(1)", "entity": "&lt;&#0;&amp", "cdata": "x]]>y",
    "comment of XML": "a -- b --> <x/> -", "backslashes": "\\ \\\\ \\n \\u0041 \\x",
    "directions": "a\u202e\u2066b\u2069",
    "surrogate": "a\ud800b", "no character": "\ufffe\uffff", "dollars": r"$\frac$ $x_ $ \$", "comment": "# % -- ; //",
    "TeX": r"\input{/etc/passwd} \end{document} ~^_#{}% ^^5c", "Chinese": "发动机",
    "joined": "\u0646\u0645\u06cc\u200c",
    "docstring": '"""\nimport os\n"""', "nothing": "", "long": "x" * 100_000, "space": "\u3000\u00a0",
}  # fmt: skip

NAME = "".join(text for key, text in HOSTILE.items() if key not in ("long", "surrogate"))
"""All of what a scene can be called, as one name."""
