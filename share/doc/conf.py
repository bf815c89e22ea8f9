"""Configuration of the documentation site (`make docs`): Sphinx with Markdown pages and the theme furo.

The built pages request nothing from the network: fonts, styles, scripts and the search index are local files.
"""

import re
import sys
from pathlib import Path
from typing import Any, Final

from swarmd.hal import driver
from swarmware import __version__
from swarmware.model.airframe import Airframe

HERE: Final = Path(__file__).parent
sys.path.insert(0, str(HERE))
# autodoc evaluates annotations; this name is imported there for type checkers alone
setattr(driver, "Airframe", Airframe)  # noqa: B010  # the module does not declare it

project = "Swarmware"
author = "the Swarmware developers"
copyright = "the Swarmware developers; Apache-2.0"
release = version = __version__

extensions = ["myst_parser", "sphinx.ext.autodoc"]
source_suffix = {".md": "markdown"}
root_doc = "index"
exclude_patterns = ["site"]
suppress_warnings = ["misc.highlighting_failure"]
"""Blocks of the protocol page are named for its tests, not for a highlighter."""

myst_heading_anchors = 4
myst_enable_extensions = ["colon_fence"]

html_theme = "furo"
html_title = f"Swarmware {version}"
html_copy_source = False
"""The Markdown pages are shipped beside the site."""
html_show_sourcelink = False
html_show_search_summary = False
"""A summary is fetched, which a browser refuses to a page from a file."""

html_domain_indices = False
"""The index of names has the modules, too."""

autodoc_member_order = "bysource"
autodoc_typehints = "signature"
autodoc_default_options = {"members": True, "undoc-members": True, "show-inheritance": True}
autodoc_preserve_defaults = True
python_maximum_signature_line_length = 100
nitpicky = False

_CODE: Final = re.compile(r"`([^`]+)`")
_FIELD: Final = re.compile(r"^(Shapes|Units|Raises|Source): ", re.MULTILINE)


def to_restructured_text(text: str) -> str:
    """A docstring of this repository as reStructuredText: backticks are code, the four fields paragraphs."""
    parts = _CODE.split(text)
    prose, code = parts[::2], parts[1::2]
    escaped = [_FIELD.sub(r"\n**\1:** ", re.sub(r"([*|]|_(?=\W|$))", r"\\\1", part)) for part in prose]
    pieces = [escaped[0]]
    for quoted, after in zip(code, escaped[1:], strict=True):
        # what follows an inline literal must not touch it
        pieces += [f"``{' '.join(quoted.split())}``", f"\\{after}" if after[:1].isalnum() else after]
    return "".join(pieces)


def _docstring(app: Any, what: str, name: str, obj: Any, options: Any, lines: list[str]) -> None:
    lines[:] = to_restructured_text("\n".join(lines)).split("\n")


def setup(app: Any) -> None:
    """Connect the conversion of docstrings."""
    app.connect("autodoc-process-docstring", _docstring)
