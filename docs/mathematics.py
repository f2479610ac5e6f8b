"""Mathematics of the site as MathML, made while it is built: no script, no font, nothing to fetch.

$x$ in a line, and $$ ... \tag{I2} $$ as a block of its own with its number, which is an anchor, #eq-I2."""

import re
from xml.etree.ElementTree import Element, SubElement

from latex2mathml.converter import convert_to_element
from markdown.blockprocessors import BlockProcessor
from markdown.extensions import Extension
from markdown.inlinepatterns import InlineProcessor


class Inline(InlineProcessor):
    def handleMatch(self, match, _):
        return convert_to_element(match[1]), match.start(0), match.end(0)


class Display(BlockProcessor):
    BLOCK = re.compile(r"^\$\$\s*(.*?)\s*(?:\\tag\{([^}]*)\})?\s*\$\$$", re.S)

    def test(self, parent, block):
        return self.BLOCK.match(block.strip()) is not None

    def run(self, parent, blocks):
        match = self.BLOCK.match(blocks.pop(0).strip())
        box = SubElement(parent, "div", {"class": "equation"})
        box.append(convert_to_element(match[1], display="block"))
        if match[2]:
            box.set("id", f"eq-{match[2]}")
            SubElement(box, "span").text = f"({match[2]})"


class Mathematics(Extension):
    def extendMarkdown(self, md):
        md.inlinePatterns.register(Inline(r"(?<!\\)\$([^$\n]+?)\$", md), "mathematics", 185)
        md.parser.blockprocessors.register(Display(md.parser), "mathematics", 105)


def makeExtension(**settings):
    return Mathematics(**settings)
