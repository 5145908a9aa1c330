"""The page of an identification: one HTML file that holds its pictures and needs nothing else, as a report's does."""

from collections.abc import Sequence
from html import escape
from pathlib import Path

from groundstation.analysis.identify.figures import Figure
from groundstation.analysis.identify.found import Found
from groundstation.analysis.identify.text import number, remarks
from groundstation.analysis.report.page import document, framed

PAGE = "identification.html"


def write(folder: Path, found: Found, figures: Sequence[tuple[Figure, Path]]) -> Path:
    """Write the page into ``folder``; returns its path.

    Raises:
        OSError: it can't be written, or a picture can't be read.
    """
    name = found.seen.config.vehicle.name
    title = f"{name}, identified from {found.seen.path.name}"
    head = "".join(
        f"<th{' class=number' if i else ''}>{cell}</th>" for i, cell in enumerate(("", "found", "95 %", "told"))
    )
    rows = [f"<tr>{head}<th></th></tr>"]
    for one in found.parameters.values():
        interval = "" if one.interval is None else f"{number(one.interval[0])} to {number(one.interval[1])}"
        cells = [number(one.value), interval, number(one.told)]
        label = f"{one.title} [{one.unit}]" if one.unit else one.title
        numbers = "".join(f'<td class="number">{escape(cell)}</td>' for cell in cells)
        rows.append(f'<tr><td>{escape(label)}</td>{numbers}<td class="note">{escape(one.note)}</td></tr>')
    parts = [f"<h1>{escape(title)}</h1>"]
    parts += [f'<p class="note">{escape(line)}</p>' for line in remarks(found)]
    parts.append(f"<table>{''.join(rows)}</table>")
    parts += [framed(one.name, one.title, one.caption, path) for one, path in figures]
    page = folder / PAGE
    page.write_text(document(title, parts), "utf-8")
    return page
