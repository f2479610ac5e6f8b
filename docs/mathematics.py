"""Mathematics of the site as MathML, made while it is built: no script, no font, nothing to fetch.

``$x$`` in a line; ``$$ ... \\tag{I2} $$`` as a block of its own, whose number is an anchor, ``#eq-I2``. GitHub shows the
same text. An extension of Python-Markdown for mkdocs.yml.
"""

import re
from xml.etree.ElementTree import SubElement

from latex2mathml.converter import convert_to_element
from markdown.blockprocessors import BlockProcessor
from markdown.extensions import Extension
from markdown.inlinepatterns import InlineProcessor


class InLine(InlineProcessor):
    def handleMatch(self, match, data):
        return convert_to_element(match[1]), match.start(0), match.end(0)


class Display(BlockProcessor):
    BLOCK = re.compile(r"\$\$\s*(.*?)\s*(?:\\tag\{([^}]*)\})?\s*\$\$", re.S)

    def test(self, parent, block):
        return self.BLOCK.fullmatch(block.strip()) is not None

    def run(self, parent, blocks):
        equation, number = self.BLOCK.fullmatch(blocks.pop(0).strip()).groups()
        box = SubElement(parent, "div", {"class": "equation"})
        box.append(convert_to_element(equation, display="block"))
        for k, label in enumerate((number or "").split(", ") if number else []):
            name = SubElement(box, "span", {"id": f"eq-{label.replace(' ', '-')}"})
            name.text = ("" if k == 0 else ", ") + f"({label})"


class Mathematics(Extension):
    def extendMarkdown(self, md):
        md.inlinePatterns.register(InLine(r"(?<![\\$])\$([^$\n]+?)\$(?!\$)", md), "mathematics", 185)
        md.parser.blockprocessors.register(Display(md.parser), "mathematics", 105)


def makeExtension(**settings):
    return Mathematics(**settings)
