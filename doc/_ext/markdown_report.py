"""A directive for the reports in doc/benchmarks, which are written as Markdown.

They hold a title, paragraphs and tables.  A bar belongs to a table only between spaces,
so that a cell may contain ``|s|``.
"""

import re
from pathlib import Path

from docutils import nodes
from sphinx.util.docutils import SphinxDirective

BAR = re.compile(r"(?<=\s)\|(?=\s)")


class MarkdownReport(SphinxDirective):
    """Insert a report, without its title."""

    required_arguments = 1

    def run(self):
        """Return the nodes of the report."""
        name, path = self.env.relfn2path(self.arguments[0])
        self.env.note_dependency(name)
        blocks = re.split(r"\n{2,}", Path(path).read_text(encoding="utf-8").strip())
        return [
            table(block.splitlines()) if block.startswith("|") else paragraph(block)
            for block in blocks
            if not block.startswith(("#", "!["))
        ]


def paragraph(text):
    """Return a paragraph; backquotes mark literals."""
    node = nodes.paragraph()
    for i, part in enumerate(text.replace("\n", " ").split("`")):
        node += nodes.literal(part, part) if i % 2 else nodes.Text(part)
    return node


def table(lines):
    """Return a table from its lines, the second of which is a rule."""
    rows = [[cell.strip() for cell in BAR.split(f" {line} ")[1:-1]] for line in lines]
    header, _, *body = rows
    group = nodes.tgroup(cols=len(header))
    group += [nodes.colspec(colwidth=1) for _ in header]
    for part, content in ((nodes.thead(), [header]), (nodes.tbody(), body)):
        for cells in content:
            row = nodes.row()
            row += [nodes.entry("", paragraph(cell)) for cell in cells]
            part += row
        group += part
    return nodes.table("", group)


def setup(app):
    """Register the directive."""
    app.add_directive("markdown-report", MarkdownReport)
    return {"version": "1", "parallel_read_safe": True}
