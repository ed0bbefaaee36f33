"""Sphinx configuration; build with ``python -m sphinx -W --keep-going -b html docs docs/_build/html``.

The build needs no network. Formulas are MathML, which browsers draw themselves, and the pages of other projects to
which the reference links are listed in ``inventories``.
"""

import os
import sys
from pathlib import Path

import hbbogie

sys.path.insert(0, str(Path(__file__).parent / "extensions"))
# the kernels of the notebooks inherit these; they show figures only where no other backend is asked for
os.environ.update(OMP_NUM_THREADS="1", OPENBLAS_NUM_THREADS="1")
os.environ.pop("MPLBACKEND", None)

project = "hbbogie"
author = "the hbbogie developers"
copyright = "2026, the hbbogie developers"
version = release = hbbogie.__version__

extensions = [
    "myst_nb",
    "sphinx.ext.autodoc",
    "sphinx.ext.intersphinx",
    "sphinx.ext.napoleon",
    "sphinx.ext.viewcode",
    "sphinx_copybutton",
    "sphinx_design",
    "generated_pages",
    "mathml",
]
exclude_patterns = ["_build", "images"]
html_math_renderer = "mathml"

myst_enable_extensions = ["colon_fence", "dollarmath", "amsmath", "deflist"]
myst_heading_anchors = 3

nb_execution_mode = "cache"
nb_execution_raise_on_error = True
nb_execution_timeout = 120
nb_merge_streams = True

intersphinx_mapping = {
    name: (address, f"inventories/{name}.txt")
    for name, address in {
        "casadi": "https://web.casadi.org/python-api/",
        "matplotlib": "https://matplotlib.org/stable/",
        "numpy": "https://numpy.org/doc/stable/",
        "python": "https://docs.python.org/3/",
        "scipy": "https://docs.scipy.org/doc/scipy/",
        "xarray": "https://docs.xarray.dev/en/stable/",
    }.items()
}

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
html_static_path = ["static"]
html_css_files = ["style.css"]
copybutton_prompt_text = r"\$ |>>> |\.\.\. "
copybutton_prompt_is_regexp = True

# types in docstrings are short names, of which several modules may have one (`Critical`, `Point`)
suppress_warnings = ["ref.python"]
