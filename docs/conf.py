"""Sphinx configuration of the documentation site; `python3 scripts/docs.py` builds it."""

from __future__ import annotations

import re
import sys
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parent))

import generated_pages

import lwrprobe

project = "lwrprobe"
author = copyright = "The lwrprobe authors"
release = lwrprobe.__version__

extensions = ["myst_parser", "sphinx.ext.autodoc", "sphinx.ext.napoleon", "sphinx.ext.viewcode"]
source_suffix = {".md": "markdown"}
exclude_patterns = ["_build"]
default_role = "code"
myst_heading_anchors = 3
myst_enable_extensions = ["colon_fence"]

autodoc_typehints_format = "short"
python_maximum_signature_line_length = 100
autodoc_member_order = "bysource"
autodoc_default_options = {"members": True}
autodoc_preserve_defaults = True
napoleon_google_docstring = False
napoleon_use_ivar = True
napoleon_attr_annotations = False  # they stand in the signature

html_theme = "furo"
html_title = f"lwrprobe {release}"
html_static_path = ["_static"]
html_css_files = ["site.css"]
html_show_sphinx = False

_FENCE = re.compile(r"^```(bash|python|toml|text) (parse-only|file=(\S+)|output)$", re.MULTILINE)
_SAYS = {"parse-only": "options checked, not run by the tests", "output": "output"}


def _label_fences(app: object, name: str, source: list[str]) -> None:
    """Show the reader what the word behind a fence's language tells the tests (tests/docs/page_runner.py)."""
    source[0] = _FENCE.sub(_labelled, source[0])


def _labelled(fence: re.Match[str]) -> str:
    language, word, file = fence.groups()
    caption = file.replace("_", r"\_") if file else _SAYS[word]  # a caption is Markdown: __init__ would be bold
    return f"```{{code-block}} {language}\n:caption: {caption}\n"


_SECTIONS = ("Parameters", "Attributes", "Raises")
_NAMED = re.compile(r"(?:^|; )([\w, ]+?) : ")


def _split_items(app: object, what: str, name: str, thing: object, options: object, lines: list[str]) -> None:
    """`name : text; name : text` in a section of a docstring are names with their texts.

    The numpy style would read the text as a type.
    """
    out, inside = [], False
    for number, line in enumerate(lines):
        if line in _SECTIONS and "".join(lines[number + 1 : number + 2]).startswith("---"):
            inside = True
        parts = _NAMED.split(line) if inside else [line]
        if len(parts) > 1 and not parts[0]:
            for key, text in zip(parts[1::2], parts[2::2]):
                out += [key, f"    {text}"]
        else:
            out.append(line)
        inside = inside and bool(line)
    lines[:] = out


_ARRAY = re.compile(r"ndarray\[tuple\[Any, \.\.\.\], dtype\[\w+\]\]")


def _shorten(app: object, what: str, name: str, thing: object, options: object, signature: str, result: str):
    """Arrays by one word: their shapes and units are in the text."""
    return tuple(text and _ARRAY.sub("ndarray", text) for text in (signature, result))


def setup(app) -> None:
    """Write the generated pages before Sphinx looks for pages."""
    app.connect("builder-inited", lambda _: generated_pages.write(Path(__file__).parent / "reference" / "generated"))
    app.connect("source-read", _label_fences)
    app.connect("autodoc-process-docstring", _split_items, priority=400)  # before napoleon's
    app.connect("autodoc-process-signature", _shorten)
