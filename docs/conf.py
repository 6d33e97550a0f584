"""Settings of the documentation site (`make docs`): the pages of this folder, and references made from the code."""

import sys
from importlib import metadata
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parent / "site"))

project = "Puppetline"
author = "The Puppetline authors"
release = metadata.version("puppetline")

extensions = ["myst_parser", "sphinx.ext.autodoc", "sphinx.ext.napoleon", "figures", "links", "reference"]
exclude_patterns = ["site"]
myst_heading_anchors = 4
myst_enable_extensions = ["colon_fence"]
suppress_warnings = ["misc.highlighting_failure", "config.cache"]
highlight_language = "none"

autodoc_member_order = "bysource"
autodoc_typehints = "signature"
autodoc_typehints_format = "short"
python_use_unqualified_type_names = True
napoleon_google_docstring = False
napoleon_use_rtype = False
napoleon_use_ivar = True

html_theme = "furo"
html_title = "Puppetline"
html_show_sphinx = False
html_copy_source = False
html_static_path = ["site/static"]
html_css_files = ["site.css"]
