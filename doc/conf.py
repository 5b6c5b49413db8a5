"""Configuration of the documentation; it builds without network access."""

import importlib.util
import os
import re
import sys
from pathlib import Path

DOC = Path(__file__).parent
EXAMPLES = DOC.parent / "examples"
sys.path[:0] = [str(DOC.parent), str(DOC / "_ext")]

import alssnn  # noqa: E402

project = "alssnn"
author = "alssnn developers"
copyright = "2026, alssnn developers"
version = release = alssnn.__version__

extensions = [
    "sphinx.ext.autodoc",
    "sphinx.ext.autosummary",
    "sphinx.ext.mathjax",
    "numpydoc",
    "markdown_report",
    "tutorial",
]
templates_path = ["_templates"]
exclude_patterns = ["_build"]
suppress_warnings = []

# Equations are numbered by section and cited by label: :eq:`compress`.
numfig = True
math_numfig = True
math_eqref_format = "eq. {number}"

autosummary_generate = True
autodoc_typehints = "none"  # the tables of parameters say more
numpydoc_show_class_members = False  # the class template lists them

html_theme = "furo"
html_title = f"alssnn {version}"
html_css_files = ["alssnn.css"]

# MathJax from a package of Python, beside the pages: formulas need no network. Of its
# files the one that draws with SVG, since browsers refuse fonts to pages on a disk.
mathjax = Path(importlib.util.find_spec("sphinx-mathjax-offline").origin).parent
html_static_path = ["_static", str(mathjax / "static" / "mathjax" / "tex-svg.js")]
mathjax_path = "tex-svg.js"

if any(EXAMPLES.glob("plot_*.py")):
    extensions.append("sphinx_gallery.gen_gallery")
    sphinx_gallery_conf = {
        "examples_dirs": str(EXAMPLES),
        "gallery_dirs": "auto_examples",
        "within_subsection_order": "FileNameSortKey",
        "abort_on_example_error": True,
        "download_all_examples": False,
        "show_memory": False,
        "parallel": os.cpu_count() or 1,  # fits of some seconds each
    }
else:  # index.rst names the gallery all the same
    exclude_patterns.append("auto_examples/*")
    suppress_warnings.append("toc.excluded")


THUMBNAIL = re.compile(
    r'(_thumb\.png\n +:alt:)(\n(?:(?!_thumb\.png).)*?thumbnail-title">)([^<]+)', re.S
)


def name_thumbnails(app, docname, source):
    """Give thumbnails of the gallery a text: the title of their example."""
    if docname.startswith("auto_examples"):
        source[0] = THUMBNAIL.sub(r"\1 \3\2\3", source[0])


def setup(app):
    app.connect("source-read", name_thumbnails)
