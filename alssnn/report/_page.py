"""HTML of a page: sections, tables, matrices and figures, with all text escaped."""

import base64
import io
import re
from html import escape
from pathlib import Path

import numpy as np

DPI = 110
LEGIBLE = 0.45  # smallest scale of a figure
# What a part of a report may fail on without the rest: its reason is the content.
REFUSED = (ValueError, RuntimeError, np.linalg.LinAlgError)
STYLE, SCRIPT = (Path(__file__).with_name(z) for z in ("page.css", "figures.js"))
CODE = re.compile("`([^`]+)`")


def page(title, origin, sections):
    """Return the whole page for a title and sections of (key, heading, content).

    Parameters
    ----------
    title : str
        Title of the page.
    origin : str
        Where the page comes from, below the title.
    sections : list of tuple of str
        Key, heading and HTML of every section.

    Returns
    -------
    html : str
        HTML.
    """
    style, script = (path.read_text(encoding="utf-8") for path in (STYLE, SCRIPT))
    links = "".join(f'<a href="#{key}">{escape(text)}</a>' for key, text, _ in sections)
    body = "".join(
        f'<section id="{key}"><h2>{escape(text)}</h2>{content}</section>\n'
        for key, text, content in sections
    )
    return (
        '<!DOCTYPE html>\n<html lang="en">\n<head>\n<meta charset="utf-8">\n'
        '<meta name="viewport" content="width=device-width, initial-scale=1">\n'
        f"<title>{escape(title)}</title>\n<style>\n{style}</style>\n</head>\n<body>\n"
        f"<h1>{escape(title)}</h1>\n{paragraph(origin, 'note')}\n<nav>{links}</nav>\n"
        f"{body}<script>{script}</script>\n</body>\n</html>\n"
    )


def words(text):
    """Return plain text as HTML; what stands between back-ticks is code.

    Parameters
    ----------
    text : str
        Text.

    Returns
    -------
    html : str
        HTML.
    """
    return CODE.sub(r"<code>\1</code>", escape(text))


def paragraph(text, kind=""):
    """Return a paragraph of plain text.

    Parameters
    ----------
    text : str
        Text.
    kind : str, default=""
        Class of the paragraph, for its style.

    Returns
    -------
    html : str
        HTML.
    """
    attribute = f' class="{kind}"' if kind else ""
    return f"<p{attribute}>{words(text)}</p>"


def attempt(make, what):
    """Return the content that `make` returns, or why there is none.

    Parameters
    ----------
    make : callable
        Function without arguments that returns HTML.
    what : str
        What it is, in a few words.

    Returns
    -------
    html : str
        HTML.
    """
    try:
        return make()
    except REFUSED as error:
        return paragraph(f"{what}: not available. {error}", "note")


def heading(text):
    """Return a heading inside a section.

    Parameters
    ----------
    text : str
        Text.

    Returns
    -------
    html : str
        HTML.
    """
    return f"<h3>{escape(text)}</h3>"


def number(value, digits=3):
    """Return a number as text; a dash for None and nan, which are no numbers.

    Parameters
    ----------
    value : float or None
        Number.
    digits : int, default=3
        Significant digits.

    Returns
    -------
    text : str
        The text.
    """
    if value is None or np.isnan(value):
        return "-"
    value = float(value)
    return f"{value:.{digits}g}" if np.isfinite(value) else str(value)


def table(header, rows, kind=""):
    """Return a table; numbers are aligned right, strings are escaped.

    Parameters
    ----------
    header : sequence of str
        Names of the columns; empty for a table without a head.
    rows : sequence
        Rows of cells.
    kind : str, default=""
        Class of the table, for its style.

    Returns
    -------
    html : str
        HTML.
    """
    head = ""
    if header:
        cells = (
            f'<th scope="col"{_kind(column)}>{escape(name)}</th>'
            for name, *column in zip(header, *rows, strict=True)
        )
        head = f"<thead><tr>{''.join(cells)}</tr></thead>"
    body = "".join(f"<tr>{''.join(map(_cell, row))}</tr>" for row in rows)
    attribute = f' class="{kind}"' if kind else ""
    return (
        f'<div class="scroll"><table{attribute}>{head}'
        f"<tbody>{body}</tbody></table></div>"
    )


def _kind(column):
    """Return the attribute of a heading: right above numbers."""
    return ' class="n"' if any(map(_is_number, column)) else ""


def _is_number(value):
    return isinstance(value, (int, float, np.number)) and not isinstance(value, bool)


def _cell(value):
    if isinstance(value, (int, np.integer)) and not isinstance(value, bool):
        return f'<td class="n">{value}</td>'
    if value is None or _is_number(value):
        return f'<td class="n">{number(value)}</td>'
    kind = {"pass": ' class="pass"', "FAIL": ' class="fail"'}.get(value, "")
    return f"<td{kind}>{words(str(value))}</td>"


def matrix(name, values, what=""):
    """Return a named matrix, or a vector as a column.

    Parameters
    ----------
    name : str
        Name.
    values : array_like
        Numbers, one or two dimensions.
    what : str, default=""
        What it is, in a few words.

    Returns
    -------
    html : str
        HTML.
    """
    rows = np.asarray(values, dtype=float)
    rows = rows[:, None] if rows.ndim == 1 else rows
    body = "".join(
        "<tr>" + "".join(f'<td class="n">{number(z, 5)}</td>' for z in row) + "</tr>"
        for row in rows
    )
    words = f"{name}, {' x '.join(map(str, rows.shape))}"
    words += f": {what}" if what else ""
    return (
        f'<p class="note">{escape(words)}</p><div class="scroll">'
        f'<table class="matrix"><tbody>{body}</tbody></table></div>'
    )


def python_code(summary, arrays):
    """Return arrays by name as Python to copy, exact to the bit, folded away.

    Parameters
    ----------
    summary : str
        What stays visible.
    arrays : dict of str to ndarray
        Arrays by name.

    Returns
    -------
    html : str
        HTML.
    """
    code = "import numpy as np\n\n" + "\n".join(
        f"{name} = np.array({np.asarray(z, dtype=float).tolist()!r})"
        for name, z in arrays.items()
    )
    return (
        f"<details><summary>{escape(summary)}</summary><pre>{escape(code)}</pre>"
        "</details>"
    )


def figure(display, caption):
    """Return a figure as PNG inside the page, with its curves for who can zoom.

    Parameters
    ----------
    display : Display
        What drew the figure.
    caption : str
        What it shows.

    Returns
    -------
    html : str
        HTML.
    """
    from ..plotting import figure_curves

    drawn, buffer = display.figure_, io.BytesIO()
    drawn.savefig(buffer, format="png", dpi=DPI)
    data = base64.b64encode(buffer.getvalue()).decode("ascii")
    # narrower than this the page scrolls the figure, for its letters to be read
    least = LEGIBLE * DPI * drawn.get_size_inches()[0]
    said = escape(caption.replace("`", ""))
    return (
        '<figure class="curves"><div class="scroll"><img '
        f'style="min-width: {least:.0f}px" alt="{said}" '
        f'src="data:image/png;base64,{data}"></div>'
        f'<script type="application/json">{figure_curves(drawn)}</script>'
        f"<figcaption>{words(caption)}</figcaption></figure>"
    )
