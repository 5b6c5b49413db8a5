"""Configuration of the documentation; it builds without network access."""

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
html_static_path = ["_static"]
suppress_warnings = []

# Equations are numbered by section and cited by label: :eq:`compress`.
numfig = True
math_numfig = True
math_eqref_format = "eq. {number}"

autosummary_generate = True
numpydoc_show_class_members = False  # the class template lists them

html_theme = "alabaster"
html_theme_options = {
    "description": "Neural state-space identification for control",
    "fixed_sidebar": True,
    "page_width": "70em",
}

if any(EXAMPLES.glob("plot_*.py")):
    extensions.append("sphinx_gallery.gen_gallery")
    sphinx_gallery_conf = {
        "examples_dirs": str(EXAMPLES),
        "gallery_dirs": "auto_examples",
        "within_subsection_order": "FileNameSortKey",
        "abort_on_example_error": True,
        "download_all_examples": False,
        "show_memory": False,
    }
else:  # index.rst names the gallery all the same
    exclude_patterns.append("auto_examples/*")
    suppress_warnings.append("toc.excluded")
