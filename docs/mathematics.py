"""Mathematics of the site as MathML, made while it is built: no script, no font, nothing to fetch.

``$x$`` in a line; ``$$ ... \\tag{I2} $$`` as a block of its own, whose number is an anchor, ``#eq-I2``. GitHub shows
the same text. An extension of Python-Markdown for mkdocs.yml.
"""

import re
from xml.etree.ElementTree import Element, SubElement, fromstring

from latex2mathml.converter import convert
from markdown.blockprocessors import BlockProcessor
from markdown.extensions import Extension
from markdown.inlinepatterns import InlineProcessor

BOLD = re.compile(r"\\mathbf ([A-Za-z])")


def mathml(latex: str, display: str) -> Element:
    """The element math. Bold letters in braces become Unicode's own, which all browsers draw."""
    latex = BOLD.sub(r"\\mathbf{\1}", latex)
    return fromstring(convert(latex, xmlns="", display=display).replace(' xmlns=""', ""))


class InLine(InlineProcessor):
    def handleMatch(self, match, data):
        return mathml(match[1], "inline"), match.start(0), match.end(0)


class Display(BlockProcessor):
    BLOCK = re.compile(r"\$\$\s*(.*?)\s*(?:\\tag\{([^}]*)\})?\s*\$\$", re.S)

    def test(self, parent, block):
        return self.BLOCK.fullmatch(block.strip()) is not None

    def run(self, parent, blocks):
        equation, number = self.BLOCK.fullmatch(blocks.pop(0).strip()).groups()
        box = SubElement(parent, "div", {"class": "equation"})
        box.append(mathml(equation, "block"))
        labels = (number or "").split(", ") if number else []
        for label in labels:
            name = SubElement(box, "span", {"id": f"eq-{label.replace(' ', '-')}"})
        if labels:
            between = "-" if len(labels) > 2 else ", "
            name.text = between.join(f"({label})" for label in dict.fromkeys((labels[0], labels[-1])))


class Mathematics(Extension):
    def extendMarkdown(self, md):
        md.inlinePatterns.register(InLine(r"(?<![\\$])\$([^$\n]+?)\$(?!\$)", md), "mathematics", 185)
        md.parser.blockprocessors.register(Display(md.parser), "mathematics", 105)


def makeExtension(**settings):
    return Mathematics(**settings)
