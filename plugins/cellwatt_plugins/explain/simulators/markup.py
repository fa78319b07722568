"""XML written by a person, with selected changes: everything else stays the same to the byte."""

from __future__ import annotations

import re
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path
from xml.parsers import expat
from xml.sax.saxutils import quoteattr


@dataclass(eq=False)
class Element:
    """One element and its pending changes: start tag at bytes ``start`` to ``end``, whole element up to ``past``."""

    tag: str
    attributes: dict[str, str]
    """Attributes as read."""
    parent: Element | None
    start: int
    end: int
    past: int = 0
    children: list[Element] = field(default_factory=list)
    changed: dict[str, str] = field(default_factory=dict)
    """Attributes to be written."""
    added: list[str] = field(default_factory=list)
    """Lines of XML to be written as its first children."""
    instead: str | None = None
    """A line of XML to be written in place of the element."""

    def iter(self, tag: str | None = None) -> Iterator[Element]:
        """All elements below this one, or those with a tag, in the order of the text."""
        for child in self.children:
            if tag in (None, child.tag):
                yield child
            yield from child.iter(tag)

    def child(self, tag: str) -> Element | None:
        """The first child with a tag."""
        return next((child for child in self.children if child.tag == tag), None)

    def set(self, **attributes: str) -> None:
        """Set attributes to be written."""
        self.changed |= attributes


class Markup:
    """The XML ``text`` of a file and its pending changes. Raises ``expat.ExpatError`` if it is not well formed."""

    def __init__(self, text: str, path: Path) -> None:
        self.path = path
        self._bytes = text.encode()
        self.root = _parsed(self._bytes)

    @property
    def changed(self) -> bool:
        """True if the changes alter the text."""
        return self.text().encode() != self._bytes

    def text(self) -> str:
        """The text with all changes."""
        out = self._bytes
        for element in reversed([self.root, *self.root.iter()]):
            if element.instead is not None:
                out = out[: element.start] + element.instead.encode() + out[element.past :]
            elif element.changed or element.added:
                out = out[: element.start] + self._tag(element).encode() + out[element.end :]
        return out.decode()

    def _tag(self, element: Element) -> str:
        """The start tag with its changed attributes and added first children."""
        tag = self._bytes[element.start : element.end].decode()
        for name, value in element.changed.items():
            tag = _with_attribute(tag, name, value)
        if not element.added:
            return tag
        margin = self._margin(element)
        inner = "".join(f"\n{margin}  {line}" for line in element.added)
        return f"{tag[:-2].rstrip()}>{inner}\n{margin}</{element.tag}>" if tag.endswith("/>") else tag + inner

    def _margin(self, element: Element) -> str:
        """Indentation of the line in which an element starts."""
        line = self._bytes[: element.start].decode().rpartition("\n")[2]
        return line[: len(line) - len(line.lstrip())]


def number(value: float) -> str:
    """A number in up to ten digits; rounding errors of 0 are written as 0."""
    return f"{round(value, 13) + 0.0:.10g}"


def _with_attribute(tag: str, name: str, value: str) -> str:
    found = re.search(rf"(\s{re.escape(name)}\s*=\s*)(\"[^\"]*\"|'[^']*')", tag)
    if found:
        return tag[: found.start()] + found.group(1) + quoteattr(value) + tag[found.end() :]
    body, close = (tag[:-2].rstrip(), "/>") if tag.endswith("/>") else (tag[:-1].rstrip(), ">")
    return f"{body} {name}={quoteattr(value)}{close}"


def _parsed(text: bytes) -> Element:
    parser = expat.ParserCreate()
    open_: list[Element] = []
    root: list[Element] = []

    def start(tag: str, attributes: dict[str, str]) -> None:
        at = parser.CurrentByteIndex
        element = Element(tag, attributes, open_[-1] if open_ else None, at, _tag_end(text, at))
        (open_[-1].children if open_ else root).append(element)
        open_.append(element)

    def end(tag: str) -> None:
        element, at = open_.pop(), parser.CurrentByteIndex
        empty = text[element.end - 2 : element.end] == b"/>"
        element.past = element.end if empty else text.index(b">", at) + 1

    parser.StartElementHandler, parser.EndElementHandler = start, end
    parser.Parse(text, True)
    return root[0]


def _tag_end(text: bytes, start: int) -> int:
    """Index after the ``>`` of the tag that begins at ``start``; a ``>`` in quotes does not count."""
    quote = 0
    for at in range(start, len(text)):
        byte = text[at]
        if quote:
            quote = 0 if byte == quote else quote
        elif byte in b"\"'":
            quote = byte
        elif byte == ord(">"):
            return at + 1
    return len(text)
