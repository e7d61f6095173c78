"""How Sphinx builds the documentation site: `python -m sphinx -W docs build/site`."""

import logging
import sys
from pathlib import Path

from minerva_bus import __version__

sys.path.insert(0, str(Path(__file__).parent / "extensions"))

project = "Minerva Bus"
copyright = "Minerva Bus contributors, Apache-2.0"
release = __version__
extensions = [
    "myst_nb",
    "sphinx.ext.autodoc",
    "sphinx.ext.napoleon",
    "sphinx_design",
    "command_line",
    "gallery",
    "highlighting",
    "mathml",
    "public_api",
    "repository",
]
html_theme = "furo"
html_title = "Minerva Bus"
html_math_renderer = "mathml"
html_copy_source = False
html_show_sourcelink = False
myst_enable_extensions = ["colon_fence", "deflist", "dollarmath"]
myst_heading_anchors = 4
myst_update_mathjax = False
nb_execution_mode = "off"
default_role = "py:obj"  # Docstrings mark names and code with single backquotes.
autodoc_member_order = "bysource"
autodoc_typehints = "description"
autodoc_typehints_description_target = "documented_params"
python_use_unqualified_type_names = True
smartquotes = False  # Options begin with two hyphens.

# Sections fill up: an index page may name more patterns than there are pages.
logging.getLogger("sphinx.sphinx.directives.other").addFilter(
    lambda record: "glob pattern" not in record.msg
)
