"""The documentation site: `make docs` builds it of these pages, without a warning, into .build/site."""

from __future__ import annotations

import sys
from importlib.metadata import version as version_of
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parent))

import site_directives

project = "kaneflex"
author = copyright = "kaneflex developers"
release = version_of("kaneflex")
extensions = ["myst_nb", "sphinx.ext.autodoc", "sphinx.ext.autosummary", "numpydoc", "sphinx-mathjax-offline"]
exclude_patterns = ["pictures", "data"]
html_theme = "furo"
smartquotes = False  # --at is no dash
html_title = "kaneflex"
myst_heading_anchors = 4
myst_enable_extensions = ["dollarmath", "amsmath"]
nb_execution_mode = "force"  # a notebook that fails is a warning, and warnings end the build
nb_execution_raise_on_error = True
nb_execution_timeout = 300
autodoc_preserve_defaults = True
autodoc_typehints = "signature"
numpydoc_show_class_members = False
autosummary_generate = False


def setup(app) -> None:
    app.add_directive("equations", site_directives.Equations)
    app.add_directive("functions", site_directives.Functions)
    app.add_directive("measured", site_directives.Measured)
    app.add_directive("messages", site_directives.Messages)
    app.add_directive("summary", site_directives.Summary)
