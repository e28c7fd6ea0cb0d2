"""The site's configuration: `make docs` builds it without a network, and every warning is an error.

The folder of sources is the checkout, so that links between pages also work for readers of the
files; `include_patterns` chooses the pages.
"""

from __future__ import annotations

import os
import sys
from pathlib import Path

# Use OpenGL without a display, so that a build does not depend on the display of a user.
os.environ.setdefault("PYOPENGL_PLATFORM", "egl")
HERE = Path(__file__).resolve().parent
sys.path.insert(0, str(HERE / "_extensions"))

import pictures  # noqa: E402 - from the folder added above

import xfrustum  # noqa: E402

project = "xfrustum"
author = "The xfrustum maintainers"
copyright = "2026, the xfrustum maintainers"
version = release = str(xfrustum.__version__)

root_doc = "docs/index"
include_patterns = ["docs/**", "CHANGELOG.md", "CONTRIBUTING.md", "CONVENTIONS.md"]
exclude_patterns = [
    ".*", "build", "compare", "dist", "raster", "reference", "report", "reports", "research", "scenes",
    "scripts", "src", "tests",
    "docs/_*", "docs/examples",
]  # fmt: skip
extensions = [
    "sphinx.ext.autodoc",
    "sphinx.ext.autosummary",
    "numpydoc",
    "myst_parser",
    "sphinx_gallery.gen_gallery",
    "command_help",
    "name_examples",
    "pictures",
]
templates_path = [
    str(HERE / "_templates")
]  # absolute, because autosummary resolves paths from the folder of sources
suppress_warnings = ["config.cache"]  # settings of the gallery hold functions: not cacheable

# Pages in Markdown.
myst_heading_anchors = 3
myst_links_external_new_tab = False

# Names of the public API; docs/api/index.rst lists them.
autosummary_generate = True
autosummary_ignore_module_all = False
python_maximum_signature_line_length = 88
# Fields are explained by comments beside them, which autodoc shows with the methods.
numpydoc_show_class_members = False
autodoc_default_options = {"member-order": "bysource"}

sphinx_gallery_conf = {
    "examples_dirs": ["docs/examples"],
    "gallery_dirs": ["docs/gallery"],
    "filename_pattern": r"/plot_",
    "image_scrapers": (pictures.scraper,),
    "reset_modules": (),
    "within_subsection_order": "FileNameSortKey",
    "download_all_examples": False,
    "show_memory": False,
    "write_computation_times": False,  # the page of times would fetch scripts from other hosts
    "show_signature": False,
    "remove_config_comments": True,
    "abort_on_example_error": False,
    "capture_repr": (),
    "notebook_extensions": {".py"},
    "plot_gallery": "True",
}

html_theme = "pydata_sphinx_theme"
html_title = f"xfrustum {release}"
html_static_path = ["_static"]
html_css_files = ["site.css"]
html_extra_path = ["_static/index.html"]  # redirects the folder's index.html to the first page
html_show_sourcelink = False
html_copy_source = False
html_theme_options = {
    "logo": {"text": "xfrustum"},
    "navbar_end": ["theme-switcher"],
    "navbar_align": "left",
    "header_links_before_dropdown": 6,
    "navigation_with_keys": False,
    "show_prev_next": False,
    "show_toc_level": 2,
    "footer_start": ["copyright"],
    "footer_end": ["sphinx-version"],
    "pygments_light_style": "tango",
    "pygments_dark_style": "monokai",
}
