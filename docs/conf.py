"""How Sphinx builds the documentation site: `python -m sphinx -W docs build/site`."""

from minerva_bus import __version__

project = "Minerva Bus"
release = __version__
extensions = ["myst_nb", "sphinx.ext.autodoc", "sphinx.ext.napoleon", "sphinx_design"]
html_theme = "furo"
html_title = f"Minerva Bus {release}"
myst_enable_extensions = ["colon_fence", "deflist", "dollarmath"]
myst_heading_anchors = 4
nb_execution_mode = "off"
exclude_patterns = ["README.md"]
