"""How Sphinx builds the documentation site: `python -m sphinx -W docs build/site`."""

import gc
import logging
import os
import sys
import tempfile
from pathlib import Path

from minerva_bus import __version__

# Notebooks start worlds, whose names must not be those of worlds that already run here.
runtime = tempfile.TemporaryDirectory(prefix="minerva-site-")
os.environ["MINERVA_RUNTIME_DIR"] = runtime.name

# Documents live as long as the build: searching them for garbage takes a third of Sphinx's time.
# Without it a build takes 1 GB of memory.
gc.disable()

sys.path.insert(0, str(Path(__file__).parent / "extensions"))
# The reader of notebooks imports jsonschema, which compiles a grammar of this optional package for
# seconds; notebooks have no IRIs to check.
sys.modules["rfc3987_syntax"] = None  # type: ignore[assignment]

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
    "mermaid",
    "navigation",
    "public_api",
    "repository",
    "world_schema",
]
html_theme = "furo"
html_static_path = ["_static"]
html_css_files = ["site.css"]
html_title = "Minerva Bus"
html_math_renderer = "mathml"
html_copy_source = False
html_show_sourcelink = False
myst_enable_extensions = ["colon_fence", "deflist", "dollarmath"]
myst_heading_anchors = 4
myst_update_mathjax = False
# Notebooks are stored without outputs, so each build runs them in clean kernels.
nb_execution_mode = "auto"
nb_execution_in_temp = True
nb_execution_raise_on_error = True
nb_execution_timeout = 100
# Without a kernel, a widget shows nothing: pages show the picture that the same value has.
nb_ipywidgets_js = {}
nb_mime_priority_overrides = [("*", "application/vnd.jupyter.widget-view+json", None)]
default_role = "py:obj"  # Docstrings mark names and code with single backquotes.
autodoc_member_order = "bysource"
autodoc_typehints = "description"
autodoc_typehints_description_target = "documented_params"
python_use_unqualified_type_names = True
smartquotes = False  # Options begin with two hyphens.

logging.getLogger("traitlets").setLevel(logging.WARNING)  # It reports each notebook.
