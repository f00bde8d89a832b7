"""How the documentation site is built: ``sphinx-build -W --keep-going docs SITE``; it needs no network."""

from __future__ import annotations

import logging
import sys
from pathlib import Path

import posture_opt

HERE = Path(__file__).resolve().parent
sys.path.insert(0, str(HERE / "extensions"))
from generated_pages import write_pages  # noqa: E402
from python_names import examples_of_results  # noqa: E402

write_pages(HERE)  # now: Sphinx looks for pages before it starts its extensions

project = "posture_opt"
author = "the posture_opt authors"
copyright = "the posture_opt authors"
version = release = posture_opt.__version__

extensions = [
    "sphinx.ext.autodoc",
    "sphinx.ext.autosummary",
    "sphinx.ext.napoleon",
    "mathml",
    "myst_nb",
    "sphinx_gallery.gen_gallery",
    "short_names",
]
templates_path = ["templates"]
exclude_patterns = ["gallery", "generated/gallery/*.ipynb", "generated/gallery/*.py", "generated/parts"]
# Contents name the pages that come first and end in `*`, so that a new page needs no line; there need not be one.
logging.getLogger("sphinx.sphinx.directives.other").addFilter(lambda r: getattr(r, "subtype", "") != "empty_glob")
nitpicky = True
nitpick_ignore_regex = [
    # Types of other packages: their pages are on the network, which a build does not use.
    (r"py:.*", r"(numpy|np|casadi|ca|matplotlib|pydantic|pandas|pd|pathlib|collections|typing|os|datetime|click)\..*"),
    (r"py:.*", r"Figure"),
    (r"py:.*", r"posture_opt\.[a-z_]+\..*"),  # parts of the package that are not public
]

myst_enable_extensions = ["amsmath", "attrs_block", "colon_fence", "deflist", "dollarmath"]
myst_heading_anchors = 3
nb_execution_mode = "force"
nb_execution_raise_on_error = True
nb_execution_timeout = 120
nb_execution_in_temp = True

smartquotes = False  # two hyphens are those of an option
autodoc_typehints = "description"
autodoc_typehints_description_target = "all"
autodoc_member_order = "groupwise"
autosummary_generate = True
autosummary_context = {"returned_by": examples_of_results()}
napoleon_google_docstring = True
napoleon_numpy_docstring = False
default_role = "py:obj"

sphinx_gallery_conf = {
    "examples_dirs": ["gallery"],
    "gallery_dirs": ["generated/gallery"],
    "filename_pattern": r"plot_",
    "within_subsection_order": "FileNameSortKey",
    "image_scrapers": ["gallery_figures.scrape"],
    "abort_on_example_error": True,
    "download_all_examples": False,
    "show_memory": False,
    "write_computation_times": False,
    "remove_config_comments": True,
}

html_theme = "furo"
html_title = f"posture_opt {release}"
html_static_path = ["static"]
html_css_files = ["site.css"]
html_math_renderer = "mathml"
html_show_sphinx = False
html_copy_source = False
html_theme_options = {"navigation_with_keys": True}
