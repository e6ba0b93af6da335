"""Names that would be code, markup or commands where they are written, in every language that kaneflex writes."""

import ast
import json
import os
import re
import subprocess
import sys
from html.parser import HTMLParser
from xml.etree import ElementTree

import pytest
from click.testing import CliRunner
from command_line import cli
from hostile_names import HOSTILE, NAME
from places import ROOT
from scene_fuzz import written_toml

from kaneflex import SceneError, read_scene, scene_of
from kaneflex.cli import main
from kaneflex.derive.printers.c_module import places, prefix_of
from kaneflex.derive.printers.latex_printer import escaped
from kaneflex.multibody.model.module_loading import generate_text
from kaneflex.plots.vtk import xml_comment
from kaneflex.solve import statespace
from kaneflex.solve.statespace import modelica
from kaneflex.support import c_language, escaping
from kaneflex.support.html import shown

TEXTS = pytest.mark.parametrize("text", HOSTILE.values(), ids=HOSTILE)
WRITABLE = re.compile(r"[\n\t\x20-\x7e\u00a0-\U0010ffff]*")
"""No control characters."""


def phases(text: str) -> str:
    """What a C compiler reads: trigraphs replaced, then lines spliced (C11, 5.1.1.2)."""
    for sign, meant in zip("=/'()!<>-", "#\\^[]|{}~", strict=True):
        text = text.replace(f"??{sign}", meant)
    return text.replace("\\\n", "")


@TEXTS
def test_a_comment_of_c_is_one(text):
    for found in (c_language.c_comment(text), f"/* {c_language.c_inline(text)} */", places("X", [("a", text)], "X_N")):
        read = phases(found)
        begin = read.index("/*")
        assert read.index("*/", begin + 2) == read.rindex("*/") and "/*" not in read[begin + 2 :]
        assert WRITABLE.fullmatch(read)
    assert "\n" not in c_language.c_inline(text)


def test_literals_of_c_are_the_bytes_of_their_texts(compiler, tmp_path):
    texts = list(HOSTILE.values())
    literals = map(c_language.c_literal, texts)
    entries = "".join(f"    {{{literal}, sizeof({literal})}},\n" for literal in literals)
    comments = "\n".join(map(c_language.c_comment, texts))
    (tmp_path / "a.c").write_text(
        f"#include <stdio.h>\n{comments}\n"
        f"static const struct {{ const char *text; size_t size; }} t[] = {{\n{entries}}};\n"
        "int main(void)\n{\n    for (size_t k = 0; k < sizeof t / sizeof t[0]; k++)\n"
        "        fwrite(t[k].text, 1, t[k].size, stdout);\n    return 0;\n}\n"
    )  # fmt: skip
    strict = ("-std=c11", "-trigraphs", "-Wall", "-Wextra", "-Werror", "-Wno-overlength-strings")
    subprocess.run([compiler, *strict, "a.c", "-o", "a"], cwd=tmp_path, check=True)
    written = subprocess.run([tmp_path / "a"], capture_output=True, check=True).stdout
    assert written == b"".join(text.encode("utf-8", "replace") + b"\0" for text in texts)


def test_names_in_c_are_short_identifiers():
    for name in (*HOSTILE.values(), "int", "kaneflex_linear", "7"):
        assert re.fullmatch(r"[a-zA-Z]\w{0,60}", prefix_of(name), flags=re.ASCII), name


@TEXTS
def test_xml_is_well_formed(text):
    element = ElementTree.Element("a", {"b": escaping.visible(text)})
    element.text = escaping.visible(text)
    found = ElementTree.fromstring(ElementTree.tostring(element, encoding="UTF-8"))
    assert found.attrib["b"] == found.text or (found.text or "") == found.attrib["b"]
    assert ElementTree.fromstring(f"<a>{xml_comment(text)}<b/></a>")[0].tag == "b"


class Tags(HTMLParser):
    def __init__(self):
        super().__init__()
        self.tags, self.data = [], []

    def handle_starttag(self, tag, attrs):
        self.tags.append((tag, *attrs))

    def handle_data(self, data):
        self.data.append(data)


@TEXTS
def test_html_has_no_other_tags(text):
    parser = Tags()
    parser.feed(f'<p title="{escaping.html(text)}">{escaping.html(text)}</p>')
    parser.close()
    assert [tag[0] for tag in parser.tags] == ["p"] and len(parser.tags[0]) == 2
    assert WRITABLE.fullmatch("".join(parser.data))
    assert "<script" not in shown(text, (text,), [(text,)], (text,))
    assert not re.search("[<>]", escaping.script_data(text))


@TEXTS
def test_latex_is_one_paragraph_without_commands(text):
    found = escaped(text)
    known = r"\\textbackslash\{\}|\\textasciitilde\{\}|\\textasciicircum\{\}|\\ensuremath\{[<>|]\}|\\[#$%&_{}]"
    assert not re.search(r"[\\#$%&_{}^~<>|\n]|[^\x20-\x7e\u00a0-\u017f]", re.sub(known, "", found))


@TEXTS
def test_modelica_strings_and_names_are_one(text):
    for quote, found in (('"', statespace.modelica_string(text)), ("'", statespace.modelica_name(text))):
        assert re.fullmatch(rf"{quote}(?:[^{quote}\\\n]|\\[\\{quote}])*{quote}", found)
        assert WRITABLE.fullmatch(found)


def test_a_model_is_not_called_like_a_word_of_modelica():
    class Empty:
        t, drives, A, B, C, D = 0.0, {}, *[__import__("numpy").zeros((0, 0))] * 4
        inputs = outputs = states = input_units = output_units = ()

    assert modelica(Empty(), "model").startswith("model model_model ")


@TEXTS
@pytest.mark.parametrize("encoding", ["utf-8", "latin-1", "ascii", "cp1252", None])
def test_terminals_obey_nothing_and_can_write_all(text, encoding):
    found = escaping.terminal(f"\x1b[1mhead\x1b[0m {text}", encoding)
    assert found.startswith("\x1b[1mhead\x1b[0m ") and found.encode(encoding or "utf-8")
    assert WRITABLE.fullmatch(found.replace("\x1b[1m", "").replace("\x1b[0m", ""))
    assert not set(found) & set("\u202e\u2066\u2069")


def test_titles_of_pictures_are_drawn_as_they_stand(tmp_path):
    from kaneflex.plots import style

    with style.styled():
        figure = style.new_figure(4.0, 3.0, "")
        for k, text in enumerate(HOSTILE.values()):
            figure.text(0.1, 1.0 - 0.03 * k, escaping.picture_text(text))
        figure.suptitle(escaping.picture_text("$a$ and $"))
        style.save(figure, tmp_path / "x")
    root = ElementTree.parse(tmp_path / "x.svg").getroot()
    assert root.tag.endswith("svg") and "script" not in {element.tag.split("}")[-1] for element in root.iter()}


def test_what_is_printable_stays():
    for text in ("engine", "发动机 №5 µm²", HOSTILE["joined"], HOSTILE["space"]):
        assert escaping.visible(text) == text
    assert escaping.visible("a\x1b[0m\ud800") == "a<U+001B>[0m<U+D800>"


# ---- whole files of scenes with such names ------------------------------------------------------------------------


@pytest.fixture(scope="module")
def hostile():
    """The engine under such a name, and with such a description and assumptions."""
    return read_scene("engine").model_copy(update={"name": NAME, "description": NAME, "assumptions": {NAME: NAME}})


def test_generated_modules_know_nothing_of_it(hostile):
    found = generate_text(hostile)
    assert found == generate_text(read_scene("engine")) and ast.parse(found)


def test_a_drawing_is_well_formed_and_a_terminal_shown_no_command(tmp_path):
    file = tmp_path / "scene.toml"
    file.write_text(written_toml({"like": "engine", "name": NAME, "description": NAME}), encoding="utf-8")
    assert read_scene(file).name == NAME
    done = cli("show", file, "-o", tmp_path / "x.svg")
    assert done.exit_code == 0 and WRITABLE.fullmatch(done.output) and "<U+001B>" in done.output
    assert ElementTree.parse(tmp_path / "x.svg").getroot().tag.endswith("svg")
    assert WRITABLE.fullmatch(repr(read_scene(file)))


@pytest.mark.parametrize("key", ["\x1b[31m", "\u202e"])
def test_refusals_send_no_command_to_a_terminal(key, tmp_path):
    file = tmp_path / "scene.toml"
    file.write_text(written_toml({"like": "engine", "bodies": {key: 1}}), encoding="utf-8")
    done = cli("check", file)
    assert done.exit_code == 2 and WRITABLE.fullmatch(done.output) and key not in done.output


def test_commands_print_by_one_function_alone():
    """Which makes what they print harmless, and writable in any encoding."""
    for file in (ROOT / "src" / "kaneflex" / "cli").glob("[a-z]*.py"):
        assert not re.search(r"\b(click\.s?echo|click\.secho|print)\(", file.read_text(encoding="utf-8")), file


def test_bytes_that_are_no_text_are_refused_in_texts_and_seen_in_names_of_files(tmp_path):
    with pytest.raises(SceneError, match=r"^name = '\\udce4': not valid text\. Write it in UTF-8\.$"):
        scene_of({"like": "engine", "name": "\udce4"})
    file = tmp_path / "m\udce4.toml"
    file.write_text('like = "engine"\n')
    assert read_scene(file).name == "m<U+DCE4>"


# ---- terminals that have not all letters --------------------------------------------------------------------------


@pytest.mark.parametrize("charset", ["latin-1", "ascii", "utf-8"])
def test_a_terminal_without_the_letters_of_a_name_is_shown_their_numbers(charset, tmp_path):
    file = tmp_path / "发动机.toml"
    file.write_text(written_toml({"like": "engine", "name": "发动机 é"}), encoding="utf-8")
    done = CliRunner(charset=charset).invoke(main, ["show", str(file), "-o", str(tmp_path / "x.png"), "--force"])
    assert done.exit_code == 0, done.output
    seen = {"latin-1": "\\u53d1\\u52a8\\u673a é", "ascii": "\\u53d1\\u52a8\\u673a \\xe9", "utf-8": "发动机 é"}[charset]
    assert done.stdout.startswith(f"{seen}: ")


def test_a_system_without_letters_beyond_ascii_writes_and_says_all(tmp_path):
    """Its names of files have none of these letters, either."""
    (tmp_path / "engine.toml").write_text(written_toml({"like": "engine", "name": "发动机 é"}), encoding="utf-8")
    plain = {"LANG": "C", "LC_ALL": "C", "PYTHONCOERCECLOCALE": "0", "PYTHONUTF8": "0"}
    command = [sys.executable, "-c", "from kaneflex.cli import main; main()", "show", "engine.toml"]
    done = subprocess.run(command, cwd=tmp_path, env={**os.environ, **plain}, capture_output=True, check=False)
    assert (done.returncode, done.stderr) == (0, b"")
    assert done.stdout.startswith(b"\\u53d1\\u52a8\\u673a \\xe9: ") and (tmp_path / "___ _.png").is_file()


def test_json_is_printed_in_letters_that_every_terminal_has():
    done = cli("check", "--json-schema")
    assert done.stdout.isascii() and json.loads(done.stdout)["$defs"]
