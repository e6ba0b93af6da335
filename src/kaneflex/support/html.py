"""HTML view of a value in notebooks: a heading, notes and a table."""

from __future__ import annotations

from collections.abc import Iterable, Sequence

from kaneflex.support.escaping import html


def shown(heading: str, head: Sequence[str], rows: Iterable[Sequence[object]], notes: Iterable[str] = ()) -> str:
    """HTML of a heading, notes and a table; every text is escaped.

    Numbers have five digits and are aligned right; texts are aligned left.
    """
    note = "".join(f"<div><b>Warning:</b> {html(note)}</div>" for note in notes)
    above = "".join(f"<th style='text-align:left'>{html(text)}</th>" for text in head)
    body = "".join(f"<tr>{''.join(map(_cell, row))}</tr>" for row in rows)
    return f"<div><b>{html(heading)}</b></div>{note}<table><tr>{above}</tr>{body}</table>"


def _cell(value: object) -> str:
    number = isinstance(value, float)
    text = f"{value:.5g}" if number else str(value)
    return f"<td style='text-align:{'right' if number else 'left'}'>{html(text)}</td>"
