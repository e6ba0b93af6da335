"""``report.html``: a run on one page that needs no network, warnings and the mechanism first."""

from __future__ import annotations

import base64
import json
import math
import re
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click
import numpy as np

from kaneflex.report.presentation import modelled, printed
from kaneflex.report.tables import ending, more_tables, run_lines, sensor_cells, unit_and_factor
from kaneflex.response.time_statistics import thinned
from kaneflex.support.arguments import takes
from kaneflex.support.escaping import html, script_data

if TYPE_CHECKING:
    from kaneflex.report.summary import Summary
    from kaneflex.solve.solution import Solution

REPORT_FILE = "report.html"
_TEMPLATE = Path(__file__).with_name("page.html")
_LARGEST = 990_000
"""Largest size of a page in bytes, so that it can be sent: a megabyte less the names of omitted pictures."""
_MOST, _NUMBERS = 1500, 60_000
"""Largest number of instants of a curve, and of numbers in all curves (8 to 13 bytes each): half a page."""
_MORE = 1.25
"""Largest number of instants including extremes, relative to the number without them."""
_AT_TOP, _DRAWN_HERE = "mechanism", "sensors"
"""Picture above all numbers, and the picture of the curves that the page itself draws."""
_KINDS = {".png": "image/png", ".gif": "image/gif"}


@takes(solution="solution", folder="path")
def write_report(
    solution: Solution, folder: Path | str, pictures: Sequence[Path] = (), summary: Summary | None = None
) -> Path:
    """Write ``report.html``, a run on one page, into a folder, which is created if needed.

    Parameters
    ----------
    solution : Solution
    folder : path
    pictures : sequence of Path, optional
        PNG and GIF files, as :func:`kaneflex.draw_all` returns them.
    summary : Summary, optional
        Of the same run.
    """
    from kaneflex.report.summary import summarise

    path = Path(folder) / REPORT_FILE
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text(page(solution, summary or summarise(solution), pictures), encoding="utf-8", newline="\n")
    return path


def page(solution: Solution, summary: Summary, pictures: Sequence[Path] = ()) -> str:
    """The page of a run, HTML.

    Parameters
    ----------
    solution : Solution
    summary : Summary
        Of the same run.
    pictures : sequence of Path
        Of the PNG and GIF files those that find room become part of it, in this order.
    """
    scene = solution.model.scene
    head, rows = sensor_cells(summary) if summary.sensors else ((), [])
    filled = {
        "title": html(scene.name),
        "about": html(scene.description),
        "warnings": _warnings(summary),
        "head": "".join(f"<th>{html(text)}</th>" for text in head),
        "rows": "".join(map(_row, rows)),
        "more": "".join(_more(summary)),
        "modelled": _text(printed(solution.model.scene, modelled(solution.model))),
        "cost": _text(run_lines(summary)),
        "choice": _choice(summary),
        "data": script_data(_as_json(_data(solution, summary, head))),
    }
    template = _TEMPLATE.read_text(encoding="utf-8")
    filled["first"], filled["pictures"] = _pictures(pictures, len("".join([template, *filled.values()]).encode()))
    return re.sub(r"\{\{(\w+)\}\}", lambda found: filled[found[1]], template)


def _text(styled: str) -> str:
    """Terminal text without its bold type."""
    return html(click.unstyle(styled))


def _row(cells: Sequence[str]) -> str:
    return f'<tr data-name="{html(cells[0])}">{"".join(f"<td>{html(cell)}</td>" for cell in cells)}</tr>'


def _warnings(summary: Summary) -> str:
    stopped = ending(summary)
    kinds = [("warning stopped", stopped)] * bool(stopped) + [("warning", text) for text in summary.warnings]
    return "".join(f'<div class="{kind}">{html(text)}</div>' for kind, text in kinds)


def _more(summary: Summary) -> Iterator[str]:
    """Optional tables, and the reason for missing error estimates."""
    if summary.errors:
        yield f"<p>Errors of the sensors: {html(summary.errors)}.</p>"
    for title, text in more_tables(summary):
        yield f"<h2>{title}</h2><pre>{_text(text)}</pre>"


def _choice(summary: Summary) -> str:
    """Models that were tried for a tolerance, with the error of each."""
    if summary.choice is None:
        return ""
    tried = ""
    for each in summary.choice.attempts:
        error = "" if each.error is None else f"{100 * each.error:.2g} %"
        tried += _row((each.model, each.worst_sensor or "", error, "yes" if each.within else "no"))
    head = "".join(f"<th>{text}</th>" for text in ("model", "worst sensor", "error", "within"))
    settings = html(" ".join(summary.choice.settings))
    return f"<h2>Why this model</h2><p>Chosen: {settings}</p><table><thead><tr>{head}</tr></thead>{tried}</table>"


def _pictures(files: Sequence[Path], taken: int) -> tuple[str, str]:
    """Pictures that fit beside the bytes taken: the mechanism's; the others, then the names of those too large."""
    first, shown, large = "", "", list[str]()
    for file in files:
        if file.suffix not in _KINDS or file.stem == _DRAWN_HERE:
            continue
        data = base64.b64encode(file.read_bytes()).decode()
        name = html(file.stem.replace("_", " "))
        source = f"data:{_KINDS[file.suffix]};base64,{data}"
        figure = f'<figure><img alt="{name}" src="{source}"><figcaption>{name}</figcaption></figure>'
        if taken + len(figure.encode()) > _LARGEST:
            large.append(html(file.name))
            continue
        taken += len(figure.encode())
        if file.stem == _AT_TOP:
            first = figure
        else:
            shown += figure
    return first, shown + f"<p>Too large for this page: {', '.join(large)}.</p>" * bool(large)


def _data(solution: Solution, summary: Summary, head: Sequence[str]) -> dict[str, Any]:
    """Curves in the table's units for the page's script: axes, which the table has, sensors, rigid companions."""
    series = {name: solution.series[name] for name in summary.sensors}
    kept = _instants(solution, len(series))
    axes = [{"label": "time [s]", "values": _numbers(solution.times[kept])}]
    for drive, at in solution.drive_angles.items():
        unit, shown = ("m", at) if solution.model.scene.slides(drive) else ("deg", np.degrees(at))
        axes.append({"label": f"{drive} [{unit}]", "values": _numbers(shown[kept])})
    own: dict[str, Any] = {}
    for name, each in series.items():
        beside, found = series.get(f"{name}_rigid"), summary.sensors[name]
        unit, factor = unit_and_factor(each.unit, max(abs(found.min), abs(found.max)))
        own[name] = {
            "unit": unit, "meaning": each.meaning, "values": _numbers(factor * each.values[kept]),
            "rigid": None if beside is None else _numbers(factor * beside.values[kept]),
        }  # fmt: skip
    return {"axes": axes, "axis": int("at deg" in head and len(axes) > 1), "sensors": own}


def _instants(solution: Solution, curves: int) -> np.ndarray:
    """Indices of the instants that are drawn, with every sensor's extremes among them unless they are too many."""
    series = np.array([each.values for each in solution.series.values()])
    series = series.reshape(len(solution.series), len(solution.times))
    most = max(2, min(_MOST, _NUMBERS // max(1, curves)))
    kept = thinned(series, most)[0]
    return kept[:: max(1, math.ceil(len(kept) / (_MORE * most)))]


def _numbers(values: np.ndarray) -> str:
    """Six digits of each as an array in JSON between marks, null where there is no finite value.

    One format for all of them takes a quarter of the time of a number after the other.
    """
    text = ",".join(["%.6g"] * len(values)) % tuple(values.tolist())
    if not np.isfinite(values).all():
        text = re.sub("-?inf|nan", "null", text)
    return f"\0[{text}]\0"


def _as_json(data: Mapping[str, Any]) -> str:
    """JSON of curves whose arrays are already text."""
    text = json.dumps(data, separators=(",", ":"), allow_nan=False)
    return text.replace('"\\u0000', "").replace('\\u0000"', "")
