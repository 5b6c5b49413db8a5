"""HTML of a page: sections, tables, matrices and figures, with all text escaped."""

import base64
import io
from html import escape

import numpy as np

DPI = 110
LEGIBLE = 0.45  # smallest scale of a figure
# What a part of a report may fail on without the rest: its reason is the content.
REFUSED = (ValueError, RuntimeError, np.linalg.LinAlgError)
STYLE = """
:root { color-scheme: light; }
* { box-sizing: border-box; }
body { margin: 0 auto; max-width: 60rem; padding: 1rem; color: #1a1a1a;
  background: #fff; font: 16px/1.5 system-ui, sans-serif; overflow-wrap: anywhere; }
h1 { font-size: 1.6rem; margin: .5rem 0; }
h2 { font-size: 1.25rem; margin: 2rem 0 .5rem; border-bottom: 1px solid #ccc; }
h3 { font-size: 1rem; margin: 1.2rem 0 .3rem; }
nav a { display: inline-block; padding: .4rem .8rem .4rem 0; }
figure { margin: 1rem 0; }
img { max-width: 100%; height: auto; }
figcaption, .note { color: #555; font-size: .9rem; }
.scroll { overflow-x: auto; }
table { border-collapse: collapse; margin: .5rem 0;
  font-variant-numeric: tabular-nums; overflow-wrap: normal; }
th, td { padding: .25rem .6rem; text-align: left; vertical-align: top;
  border-bottom: 1px solid #e4e4e4; }
td.n, th.n { text-align: right; }
td.n { white-space: nowrap; }
table.matrix { border-left: 2px solid #444; border-right: 2px solid #444; }
table.matrix td { border: 0; padding: .1rem .6rem; }
pre { overflow-x: auto; background: #f5f5f5; padding: .6rem; font-size: .85rem; }
.pass { color: #00674b; font-weight: 600; }
.fail { color: #a33b00; font-weight: 600; }
.equation { font-family: Cambria, Georgia, serif; font-style: italic;
  font-size: 1.1rem; }
summary { cursor: pointer; padding: .3rem 0; }
@media (max-width: 40rem) {
  table { font-size: .875rem; }
  th, td { padding: .2rem .4rem; }
  table.checks thead { display: none; }
  table.checks tr { display: flex; flex-wrap: wrap; border-bottom: 1px solid #e4e4e4; }
  table.checks td { border: 0; }
  table.checks td:last-child { flex-basis: 100%; }
}
"""


def page(title, sections):
    """Return the whole page for a title and sections of (key, heading, content).

    Parameters
    ----------
    title : str
        Title of the page.
    sections : list of tuple of str
        Key, heading and HTML of every section.

    Returns
    -------
    html : str
        HTML.
    """
    links = "".join(f'<a href="#{key}">{escape(text)}</a>' for key, text, _ in sections)
    body = "".join(
        f'<section id="{key}"><h2>{escape(text)}</h2>{content}</section>\n'
        for key, text, content in sections
    )
    return (
        '<!DOCTYPE html>\n<html lang="en">\n<head>\n<meta charset="utf-8">\n'
        '<meta name="viewport" content="width=device-width, initial-scale=1">\n'
        f"<title>{escape(title)}</title>\n<style>{STYLE}</style>\n</head>\n<body>\n"
        f"<h1>{escape(title)}</h1>\n<nav>{links}</nav>\n{body}</body>\n</html>\n"
    )


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
    return f"<p{attribute}>{escape(text)}</p>"


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


def number(value, digits=4):
    """Return a number as text; a dash for None and nan, which are no numbers.

    Parameters
    ----------
    value : float or None
        Number.
    digits : int, default=4
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
    head = (
        "".join(
            f'<th scope="col"{_kind(column)}>{escape(name)}</th>'
            for name, *column in zip(header, *rows, strict=True)
        )
        if header
        else ""
    )
    head = f"<thead><tr>{head}</tr></thead>" if head else ""
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
    return f"<td{kind}>{escape(str(value))}</td>"


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


def figure(drawn, caption):
    """Return a matplotlib figure as PNG inside the page.

    Parameters
    ----------
    drawn : matplotlib.figure.Figure
        Figure.
    caption : str
        What it shows.

    Returns
    -------
    html : str
        HTML.
    """
    buffer = io.BytesIO()
    drawn.savefig(buffer, format="png", dpi=DPI)
    data = base64.b64encode(buffer.getvalue()).decode("ascii")
    # narrower than this the page scrolls the figure, for its letters to be read
    least = LEGIBLE * DPI * drawn.get_size_inches()[0]
    return (
        f'<figure><div class="scroll"><img style="min-width: {least:.0f}px" '
        f'alt="{escape(caption)}" src="data:image/png;base64,{data}"></div>'
        f"<figcaption>{escape(caption)}</figcaption></figure>"
    )
