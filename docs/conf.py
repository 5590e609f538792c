"""Sphinx settings of the documentation, which is read without a network: `make docs`."""

import sys
from importlib.metadata import version as installed
from importlib.util import find_spec
from pathlib import Path
from shutil import copytree

from docutils import nodes
from sphinx.application import Sphinx

sys.path.insert(0, str(Path(__file__).parent))

import made_pages

project = "jaxgear"
author = "the authors of jaxgear"
copyright = "2026, the authors of jaxgear"
version = release = installed("jaxgear")
language = "en-GB"

extensions = ["myst_nb", "sphinx.ext.mathjax"]
exclude_patterns = ["_static", "skill"]
# Strict: whatever is cited must be there.
nitpicky = True

myst_enable_extensions = ["colon_fence", "deflist", "dollarmath", "fieldlist"]
myst_heading_anchors = 3
# Notebooks take minutes each: a test of their own runs them.
nb_execution_mode = "off"
toc_object_entries_show_parents = "hide"

html_theme = "pydata_sphinx_theme"
html_title = f"jaxgear {version}"
html_static_path = ["_static"]
html_css_files = ["jaxgear.css"]
html_sidebars = {"tutorial": [], "gallery": []}
html_show_sourcelink = False
html_copy_source = False
html_theme_options = {
    "navbar_align": "left",
    "header_links_before_dropdown": 7,
    "navbar_end": ["theme-switcher"],
    "secondary_sidebar_items": ["page-toc"],
    "footer_start": ["copyright"],
    "footer_end": [],
    "show_nav_level": 1,
    "navigation_depth": 3,
    "show_prev_next": True,
}

# Formulas without a network: MathJax and its fonts come with a package and into the site.
mathjax_path = "mathjax/tex-chtml.js"


def _copied_mathjax(app: Sphinx, failure: Exception | None) -> None:
    """Put MathJax beside the pages."""
    found = find_spec("mathjax")
    if failure is not None or app.builder.format != "html" or found is None:
        return
    package = Path(found.submodule_search_locations[0]) / "static" / "mathjax" / "es5"
    target = Path(app.outdir) / "_static" / "mathjax"
    (target).mkdir(parents=True, exist_ok=True)
    (target / "tex-chtml.js").write_bytes((package / "tex-chtml.js").read_bytes())
    copytree(package / "output" / "chtml", target / "output" / "chtml", dirs_exist_ok=True)


def _numbered(app: Sphinx, document: nodes.document) -> None:
    """Hand formulas over as they stand: in the frame that Sphinx adds none may have a number."""
    del app
    for formula in document.findall(nodes.math_block):
        formula["no-wrap"] = True
        formula.children = [nodes.Text(rf"\[{formula.astext()}\]")]


def setup(app: Sphinx) -> None:
    """Write the pages that are made from the code, before pages are looked for."""
    made_pages.write_all(Path(__file__).parent / "_made")
    app.connect("doctree-read", _numbered)
    app.connect("build-finished", _copied_mathjax)
