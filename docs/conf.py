"""How Sphinx builds these pages: `sphinx-build docs out/site`, with `-t offline` where no other site can be reached."""

import sys
from importlib.metadata import version as version_of
from pathlib import Path

sys.path[:0] = [str(Path(__file__).parent / "extensions")]

project = "vijax"
author = "The vijax developers"
project_copyright = "the vijax developers"
release = version = version_of("vijax")

extensions = [
    "sphinx.ext.autodoc",
    "sphinx.ext.autosummary",
    "sphinx.ext.napoleon",
    "sphinx.ext.intersphinx",
    "myst_nb",
    "sphinx_copybutton",
    "sphinx_design",
    "all_names",
    "docstrings",
    "mathml",
    "notebooks",
]
exclude_patterns = ["extensions", "templates"]
templates_path = ["templates"]
myst_enable_extensions = ["colon_fence", "dollarmath"]
myst_heading_anchors = 3  # links to headings, as they work in the repository
html_math_renderer = "mathml"
nb_execution_mode = "off"  # notebooks are stored with their outputs

autosummary_ignore_module_all = False
autodoc_typehints = "none"  # docstrings say what arguments are, their shapes too
autodoc_preserve_defaults = True
autodoc_default_options = {"members": True}
autodoc_member_order = "bysource"
napoleon_numpy_docstring = False
napoleon_attr_annotations = False
smartquotes_action = "D"  # dashes alone: derivatives are primes
add_module_names = False
toc_object_entries_show_parents = "hide"
python_use_unqualified_type_names = True

# Links into other libraries; those that cannot be looked up are no fault of these pages.
OTHERS = {
    "diffrax": "https://docs.kidger.site/diffrax/",
    "equinox": "https://docs.kidger.site/equinox/",
    "jax": "https://docs.jax.dev/en/latest/",
    "matplotlib": "https://matplotlib.org/stable/",
    "numpy": "https://numpy.org/doc/stable/",
    "python": "https://docs.python.org/3/",
    "xarray": "https://docs.xarray.dev/en/stable/",
}
if not tags.has("offline"):
    intersphinx_mapping = {name: (address, None) for name, address in OTHERS.items()}

nitpick_ignore_regex = [("py:.*", rf"({'|'.join(OTHERS)})\..*")]

html_theme = "pydata_sphinx_theme"
html_title = f"vijax {version}"
html_show_sourcelink = False
html_static_path = ["static"]
html_css_files = ["vijax.css"]
html_sidebars = {
    page: [] for page in ("overview", "faq", "gallery", "changes", "contributing")
}  # pages without others beside them
