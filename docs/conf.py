"""Sphinx configuration; build with ``python -m sphinx -W --keep-going -b html docs docs/_build/html``."""

import hbbogie

project = "hbbogie"
author = "the hbbogie developers"
copyright = "2026, the hbbogie developers"
version = release = hbbogie.__version__

extensions = [
    "myst_parser",
    "sphinx.ext.autodoc",
    "sphinx.ext.napoleon",
    "sphinx.ext.mathjax",
    "sphinx.ext.viewcode",
]
source_suffix = {".md": "markdown"}
exclude_patterns = ["_build", "images"]

myst_enable_extensions = ["dollarmath", "amsmath", "deflist"]
myst_heading_anchors = 3

# docstrings state types, shapes and units themselves; single backquotes in them are code
default_role = "code"
autodoc_member_order = "bysource"
autodoc_typehints = "none"
napoleon_google_docstring = False
napoleon_numpy_docstring = True
napoleon_use_ivar = True
napoleon_use_rtype = False

html_theme = "furo"
html_title = f"hbbogie {release}"

# types in docstrings are short names, of which several modules may have one (`Critical`, `Point`)
suppress_warnings = ["ref.python"]
