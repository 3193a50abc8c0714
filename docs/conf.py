"""How Sphinx builds these pages: ``python -m sphinx -W --keep-going -b html docs docs/_build``.

The pages read well on GitHub too: plain Markdown, formulas between dollars. Nothing in the built pages comes
from a network, formulas included: docutils turns them into MathML, which browsers draw themselves.
"""

import re
from pathlib import Path

from docutils import nodes
from docutils.utils.math.latex2mathml import tex2mathml
from sphinx.application import Sphinx
from sphinx.writers.html5 import HTML5Translator

project = "lpfcosim"
html_title = "lpfcosim"
html_theme = "furo"
html_math_renderer = "mathml"
html_show_copyright = False
extensions = ["myst_parser"]
myst_enable_extensions = ["dollarmath"]
myst_fence_as_directive = ["math"]
myst_heading_anchors = 3
exclude_patterns = ["_build"]
nitpicky = True

OUTSIDE = {
    "readme": "README.md",
    "changelog": "CHANGELOG.md",
    "contributing": "CONTRIBUTING.md",
}  # pages that lie above this folder
_LINK = re.compile(r"\]\((?!https:|#)([^)]+)\)")


def _read(app: Sphinx, page: str, source: list[str]) -> None:
    """Take in the pages above, whose links begin one folder up, and lead links to them there."""
    if page in OUTSIDE:
        text = (Path(app.srcdir).parent / OUTSIDE[page]).read_text(encoding="utf-8")
        source[0] = _LINK.sub(r"](../\1)", text).replace("](../docs/", "](")
    for name, file in OUTSIDE.items():
        source[0] = source[0].replace(f"](../{file}", f"]({name}.md")


def _inline(translator: HTML5Translator, node: nodes.math) -> None:
    translator.body.append(tex2mathml(node.astext()))
    raise nodes.SkipNode


def _block(translator: HTML5Translator, node: nodes.math_block) -> None:
    formula = tex2mathml(node.astext(), as_block=True)
    translator.body.append(f'<div style="margin: 0.8em 0; overflow-x: auto">{formula}</div>\n')
    raise nodes.SkipNode


def setup(app: Sphinx) -> None:
    """Let Sphinx write formulas as MathML and find README and changelog."""
    app.connect("source-read", _read)
    app.add_html_math_renderer("mathml", (_inline, None), (_block, None))
