"""Run the code of the tutorial, which draws its figures.

The blocks run in order, as a reader would run them, in a folder that holds the record.
They run again if the page or the record is newer than the figures.
"""

import contextlib
import io
import os
import re
import shutil
import tempfile
import textwrap
from pathlib import Path

BLOCK = re.compile(r"\.\. code-block:: python\n\n((?:   .*\n|\n)+)")


def draw_figures(app):
    """Run the blocks, and keep the figures that they write."""
    page = Path(app.srcdir) / "tutorial.rst"
    record = Path(app.srcdir) / "tutorial" / "arm.csv"
    folder = Path(app.srcdir) / "tutorial" / "figures"
    text = page.read_text(encoding="utf-8")
    wanted = [folder / name for name in re.findall(r"tutorial/figures/(\S+)", text)]
    newest = max(path.stat().st_mtime for path in (page, record))
    if all(path.exists() and path.stat().st_mtime > newest for path in wanted):
        return
    folder.mkdir(exist_ok=True)
    here = os.getcwd()
    with tempfile.TemporaryDirectory() as work:
        shutil.copy(record, work)
        os.chdir(work)
        try:
            names = {}
            with contextlib.redirect_stdout(io.StringIO()):
                for block in BLOCK.findall(text):
                    exec(textwrap.dedent(block), names)
            for path in wanted:
                shutil.copyfile(path.name, path)
        finally:
            os.chdir(here)


def setup(app):
    """Register the run before the pages are read."""
    app.connect("builder-inited", draw_figures)
    return {"parallel_read_safe": True}
