"""The documentation site: `make docs` builds it with Sphinx from the pages of this folder, without the internet."""

from __future__ import annotations

import os
import re
from pathlib import Path
from typing import Any

from docutils import nodes
from docutils.utils.math.latex2mathml import tex2mathml
from sphinx.application import Sphinx

import roughvol

ROOT = Path(__file__).parents[1]

INCLUDED = {  # pages outside this folder, and the page that includes each
    "runs/README.md": "reference/files.md",
    "CHANGELOG.md": "reference/changes.md",
    "CONTRIBUTING.md": "explanation/contributing.md",
}

project = "roughvol"
author = "roughvol authors"
version = release = roughvol.__version__
extensions = [
    "myst_nb",
    "sphinx.ext.autodoc",
    "sphinx.ext.autosummary",
    "numpydoc",
    "sphinx_click",
    "sphinx_copybutton",
]
exclude_patterns = ["_build"]
root_doc = "index"
highlight_language = "text"

html_theme = "furo"
html_title = f"roughvol {release}"
html_static_path = ["_static"]
html_css_files = ["site.css"]
html_math_renderer = "mathml"
html_copy_source = html_use_index = html_domain_indices = False
html_show_sphinx = False
html_show_copyright = False
copybutton_exclude = ".linenos, .gp, .go"
smartquotes_action = "qe"  # quotes and ellipses; the two dashes of an option are no dash

myst_enable_extensions = ["dollarmath", "colon_fence"]
myst_heading_anchors = 3
nb_execution_mode = "force"
nb_execution_raise_on_error = True
nb_execution_show_tb = True
nb_execution_timeout = 120
nb_execution_in_temp = True
nb_merge_streams = True

autodoc_typehints = "none"  # numpydoc sections have the types
numpydoc_show_class_members = False
autosummary_generate = False


def visit_math(translator: Any, node: nodes.math) -> None:
    """Write a formula as MathML, which browsers set without a script."""
    translator.body.append(tex2mathml(node.astext()))
    raise nodes.SkipNode


def visit_math_block(translator: Any, node: nodes.math_block) -> None:
    """Write a displayed formula as MathML."""
    translator.body.append(f'<div class="math">{tex2mathml(node.astext(), as_block=True)}</div>')
    raise nodes.SkipNode


def shaped(app: Sphinx, name: str, source: list[str]) -> None:
    """Lead links to pages outside this folder to those that include them, and bring equations near their numbers."""
    source[0] = re.sub(r"^( {4}.*\S) {5,}(\(\d+\))", r"\1    \2", source[0], flags=re.MULTILINE)
    for outside, inside in INCLUDED.items():
        above = "../" * name.count("/")
        source[0] = source[0].replace(f"](../{above}{outside}", f"]({above}{inside}")


def as_code(app: Sphinx, context: Any, lines: list[str]) -> None:
    """Show the examples of a help page as code."""
    examples = [line.lstrip("| ") for line in lines if line.lstrip("| ").startswith("roughvol")]
    if examples:
        lines[:] = [".. code-block:: sh", "", *(f"   {line}" for line in examples), ""]


def setup(app: Sphinx) -> None:
    """Register the formulas, and the changes of pages before they are read."""
    app.connect("source-read", shaped)
    app.connect("sphinx-click-process-epilog", as_code)
    app.add_html_math_renderer("mathml", (visit_math, None), (visit_math_block, None))


REPORT = ROOT / "runs" / "report"
html_extra_path = [str(REPORT)] if (REPORT / "report.html").is_file() else []
if html_extra_path:
    tags.add("report")  # type: ignore[name-defined]  # noqa: F821

os.environ.setdefault("MPLBACKEND", "agg")
