"""Parts of the site that come from the code: compiled equations, and error messages by topic."""

from __future__ import annotations

import ast
import re
from collections.abc import Iterator
from pathlib import Path

from docutils import nodes
from sphinx.util.docutils import SphinxDirective

TOPICS = {
    "Links and bodies": r"scene/(beams|bodies|sections|shapes|poses)|multibody/model/shape",
    "Joints, drives and loops": r"scene/(drive|parts)|mechanism/|fem/(freedom|mobility)"
    r"|multibody/(model/(determin|initial|spatial)|time/(rigid_ref|spatial))",
    "Loads, laws and springs": r"scene/(law|load|springs|tables)|support/units",
    "Contacts and friction": r"scene/(contact|friction)|solve/(contact|touching)",
    "Links from finite elements": r"fem/imported|cli/importing|scene/modal",
    "Solving": r"solve/|multibody/|fem/|integrate/|scene/(option|start)",
    "Units, names and files": r"scene/|support/",
    "Studies and commands": r"",
}
"""Heading -> modules whose errors stand under it, by the first pattern that matches."""
SOURCES = Path(__file__).parents[1] / "src/kaneflex"
_WORDS = {"SceneError": 4, "Fault": 2}
"""What is raised of a user's mistake -> how many words it takes: key, value, reason and cure; reason and cure."""


class Equations(SphinxDirective):
    """``{equations} SCENE``: the compiled equations of a shipped scene, as `kaneflex equations` prints them."""

    required_arguments = 1

    def run(self) -> list[nodes.Node]:
        self.env.note_reread()
        from kaneflex import read_scene
        from kaneflex.derive.latex import latex

        return self.parse_text_to_nodes(as_markdown(latex(read_scene(self.arguments[0]))), allow_section_headings=True)


class Functions(SphinxDirective):
    """``{functions} NAME NAME ...``: signatures and docstrings of public functions."""

    required_arguments = 1
    final_argument_whitespace = True

    def run(self) -> list[nodes.Node]:
        lines = "".join(f".. autofunction:: kaneflex.{name}\n" for name in self.arguments[0].split())
        return self.parse_text_to_nodes(f"```{{eval-rst}}\n{lines}```\n")


class Measured(SphinxDirective):
    """``{measured} NAME``: the table docs/data/NAME.csv, with a link to the file."""

    required_arguments = 1

    def run(self) -> list[nodes.Node]:
        file = f"data/{self.arguments[0]}.csv"
        return self.parse_text_to_nodes(f"[CSV]({file})\n\n```{{csv-table}}\n:file: {file}\n:header-rows: 1\n```\n")


class Summary(SphinxDirective):
    """``{summary}``: every field of ``summary.json``, a section for each table."""

    def run(self) -> list[nodes.Node]:
        self.env.note_reread()
        from summary_fields import documentation

        return self.parse_text_to_nodes(documentation(), allow_section_headings=True)


class Messages(SphinxDirective):
    """``{messages}``: tables of error messages by topic, with the entry concerned and what to do."""

    def run(self) -> list[nodes.Node]:
        self.env.note_reread()  # the sources may have changed, where the page has not
        found = set(messages())
        lines = []
        for topic in TOPICS:
            rows = sorted(row for of, *row in found if of == topic and _tells(row[1]))
            lines += [f"\n## {topic}\n", "| entry | problem | what to do |", "|---|---|---|"]
            lines += [f"| {' | '.join(map(_cell, row))} |" for row in rows]
        return self.parse_text_to_nodes("\n".join(lines), allow_section_headings=True)


def messages() -> Iterator[tuple[str, str, str, str]]:
    """Topic, entry, problem and fix of every error whose text stands where it is raised; ``...`` for what varies."""
    for path in sorted(SOURCES.rglob("*.py")):
        name = path.relative_to(SOURCES).with_suffix("").as_posix()
        topic = next(topic for topic, pattern in TOPICS.items() if re.match(pattern, name))
        for made in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
            if isinstance(made, ast.FunctionDef):
                yield from ((topic, *row) for row in _refused_by(made))


def _refused_by(made: ast.FunctionDef) -> Iterator[tuple[str, str, str]]:
    """Those of one function, whose words may have a name in it: the last one given before."""
    named = [
        (target.id, node.lineno, node.value)
        for node in ast.walk(made) if isinstance(node, ast.Assign)
        for target in node.targets if isinstance(target, ast.Name)
    ]  # fmt: skip
    for call in ast.walk(made):
        kind = call.func.id if isinstance(call, ast.Call) and isinstance(call.func, ast.Name) else ""
        if kind not in _WORDS:
            continue
        before = {name: value for name, line, value in sorted(named, key=lambda each: each[1]) if line < call.lineno}
        words = [_said(each, before) for each in call.args]
        said = words[_WORDS[kind] - 2 :][:2]
        if len(said) == 2 and all(each.strip(". ") for each in said):  # else its words are elsewhere
            yield _entry(words[0]) if kind == "SceneError" else "-", *said


def _tells(problem: str) -> bool:
    """True if a problem has two words, or three after a computed part."""
    return len(re.findall(r"[A-Za-z]{2,}", problem)) > 1 + problem.startswith("...")


def _entry(key: str) -> str:
    """A key with NAME for a part's name; a dash if all of it is computed."""
    return "-" if key.strip(".") == "" else re.sub(r"\.\.{3}(?=\.|$)", ".NAME", key)


def _said(node: ast.expr, named: dict[str, ast.expr]) -> str:
    """A text as a reader sees it, with ``...`` for what is computed."""
    if isinstance(node, ast.Name) and node.id in named:
        return _said(named[node.id], {})
    if isinstance(node, ast.Constant):
        return str(node.value)
    if isinstance(node, ast.JoinedStr):
        return "".join(str(part.value) if isinstance(part, ast.Constant) else "..." for part in node.values)
    return "..."


def _cell(text: str) -> str:
    return re.sub(r"([|*_`<$\\\[])", r"\\\1", " ".join(text.split()))


def as_markdown(text: str) -> str:
    """A document of :func:`kaneflex.derive.latex.latex` as MyST: its sections, tables and formulas."""
    body = text[text.index(r"\maketitle") + len(r"\maketitle") : text.index(r"\end{document}")]
    body = re.sub(r"\{\\small\\begin\{tabular\}\{l+\}\n(.*?)\\end\{tabular\}\}\\medskip", _table, body, flags=re.DOTALL)
    body = re.sub(r"\\\[(.*?)\\\]", r"\n$$\1$$\n", body, flags=re.DOTALL)
    body = re.sub(r"\\section\*\{(.*?)\}", r"\n### \1\n", body)
    body = re.sub(r"\{\\raggedright (.*?)\\par\}", r"\1", body, flags=re.DOTALL)
    body = re.sub(r"\\texttt\{(.*?)\}", lambda found: f"`{_plain(found[1])}`", body)
    return re.sub(r"\\(?:medskip|allowbreak|clearpage)\b", "", body)


def _table(found: re.Match[str]) -> str:
    """A tabular as a table of Markdown."""
    rows = found[1].replace(r"\hline\noalign{\smallskip}", "").split(r"\\")
    head, *lines = [row.strip().replace("&", "|") for row in rows if row.strip()]
    rule = "|".join([" --- "] * (head.count("|") + 1))
    return "".join(f"| {line} |\n" for line in (head, rule, *lines))


def _plain(text: str) -> str:
    return text.replace(r"\_", "_").replace(r"\#", "#").replace(r"\%", "%")
