# SPDX-License-Identifier: BSD-3-Clause
"""Sphinx: how the site is built. `./bootstrap docs` calls build.py beside this file."""

import re
import sys
from pathlib import Path

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))
sys.path.insert(0, str(Path(__file__).resolve().parent))
import symsde
from docutils import nodes
from plain import as_rest

project = "symsde"
author = "symsde developers"
copyright = "symsde developers, BSD-3-Clause"
release = symsde.__version__

extensions = ["myst_parser", "sphinx.ext.autodoc", "sphinx_design", "sphinx_copybutton", "sphinx_gallery.gen_gallery"]
extensions += ["sphinx-mathjax-offline"]  # formulas show without a network
exclude_patterns = ["gallery/*", "**sg_execution_times*"]  # programs, whose pages are made in examples/; run times
myst_enable_extensions = ["colon_fence", "dollarmath"]
myst_heading_anchors = 3
numfig = True  # formulas carry the number of their chapter
numfig_secnum_depth = 1
html_theme = "furo"
html_title = f"symsde {release}"
html_show_sphinx = False
html_static_path = ["static"]
html_css_files = ["site.css"]
html_js_files = ["scroll.js"]
templates_path = []
autodoc_member_order = "bysource"
autodoc_typehints = "signature"
copybutton_exclude = ".linenos, .gp, .go"

sphinx_gallery_conf = {
    "examples_dirs": "gallery",
    "gallery_dirs": "examples",
    "filename_pattern": r"/p\d\d_.*\.py$",
    "abort_on_example_error": True,
    "capture_repr": (),
    "within_subsection_order": "FileNameSortKey",
    "download_all_examples": False,
    "remove_config_comments": True,
    "min_reported_time": 3600,
    "show_signature": False,
    "reset_modules": ("matplotlib", "gallery_style.apply"),
    "copyfile_regex": r".*\.(toml|npz)$",
}


def _docstring(_app, _what, _name, _obj, _options, lines):
    """Docstrings are plain text: nothing in them is markup but backquotes, lists and indented formulas."""
    lines[:] = as_rest("\n".join(lines)).splitlines()


def _signature(_app, what, _name, thing, _options, signature, returned):
    """Classes of results are made by functions: how the package itself makes them is no business of a reader."""
    made_by_users = (symsde.Model, symsde.observe.Observer, BaseException)
    if signature and what == "class" and (thing is symsde.FormulaModel or not issubclass(thing, made_by_users)):
        return "", None
    return signature, returned


def _numbers(app, doctree):
    """In tables no line ends within a number, which may have an exponent or a per cent sign."""
    for text in [x for entry in doctree.findall(nodes.entry) for x in entry.findall(nodes.Text)]:
        parts = re.split(r"(\d[\d.]*e[-+]\d+|\d[\d.]* %|\d[\d.]* \+- [\d.]+)", text)
        if len(parts) > 1 and not isinstance(text.parent, nodes.math | nodes.literal):
            kinds = [
                nodes.inline("", part, classes=["number"]) if i % 2 else nodes.Text(part)
                for i, part in enumerate(parts)
            ]
            text.parent.replace(text, [kind for kind, part in zip(kinds, parts, strict=True) if part])


def _punctuation(app, doctree):
    """A bracket before a formula, and a comma or the like after it, stay in its line."""
    for formula in list(doctree.findall(nodes.math)):
        around = formula.parent
        place = around.index(formula)
        before, after = (around[i] if 0 <= i < len(around) else None for i in (place - 1, place + 1))
        begin = "(" if isinstance(before, nodes.Text) and before.endswith("(") else ""
        end = re.match(r"[,.;:)]*", after)[0] if isinstance(after, nodes.Text) else ""
        if not begin + end:
            continue
        if begin:
            around.replace(before, nodes.Text(before[:-1]))
        if end:
            around.replace(after, nodes.Text(after[len(end) :]))
        around[place] = nodes.inline("", nodes.Text(begin), formula.deepcopy(), nodes.Text(end), classes=["whole"])


def _anchors(app, doctree):
    """What a page marks by <a id=".."></a> is a place that links may name, as headings are."""
    slugs = app.env.metadata[app.env.docname].setdefault("myst_slugs", {})
    for node in doctree.findall(nodes.raw):
        slugs.update({name: (node.line, name, name) for name in re.findall(r'<a id="([^"]+)">', node.astext())})


def setup(app):
    """Connect the reader of docstrings, and what changes pages that were read."""
    app.connect("doctree-read", _numbers)
    app.connect("doctree-read", _punctuation)
    app.connect("autodoc-process-docstring", _docstring)
    app.connect("autodoc-process-signature", _signature)
    app.connect("doctree-read", _anchors)
