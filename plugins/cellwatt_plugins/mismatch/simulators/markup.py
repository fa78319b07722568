"""XML that a person wrote, changed only where it must be: what is not named stays as it was, to the byte."""

from __future__ import annotations

import re
from collections.abc import Iterator
from dataclasses import dataclass, field
from xml.parsers import expat
from xml.sax.saxutils import quoteattr


@dataclass(eq=False)
class Element:
    """One element: its start tag at bytes ``start`` to ``end``, its end tag from ``close`` to ``past``."""

    tag: str
    attributes: dict[str, str]
    parent: Element | None
    start: int
    end: int = 0
    close: int = 0
    past: int = 0
    children: list[Element] = field(default_factory=list)

    def iter(self, tag: str) -> Iterator[Element]:
        """All elements of a tag below it, in the order of the text."""
        for child in self.children:
            if child.tag == tag:
                yield child
            yield from child.iter(tag)

    def child(self, tag: str) -> Element | None:
        """Its first child of a tag."""
        return next((child for child in self.children if child.tag == tag), None)


class Markup:
    """An XML text with changes to come. Raises ``expat.ExpatError`` where it is not well formed."""

    def __init__(self, text: str) -> None:
        self._bytes = text.encode()
        self.root = _parsed(self._bytes)
        self._attributes: dict[Element, dict[str, str]] = {}
        self._edits: list[tuple[int, int, bytes]] = []
        self._added: dict[Element, list[str]] = {}

    def set(self, element: Element, **attributes: str) -> None:
        """Write attributes of an element."""
        self._attributes.setdefault(element, {}).update(attributes)

    def value(self, element: Element, name: str) -> str | None:
        """An attribute as it will be."""
        return self._attributes.get(element, {}).get(name, element.attributes.get(name))

    def add(self, parent: Element, *lines: str) -> None:
        """Write lines of XML as first children of an element."""
        self._added.setdefault(parent, []).extend(lines)

    def replace(self, element: Element, line: str) -> None:
        """One line of XML in place of an element."""
        self._edits.append((element.start, element.past, line.encode()))

    def text(self) -> str:
        """The text with all changes."""
        edits = [*self._edits, *(self._tag(element) for element in {*self._attributes, *self._added})]
        out = self._bytes
        for start, end, new in sorted(edits, reverse=True):
            out = out[:start] + new + out[end:]
        return out.decode()

    def _tag(self, element: Element) -> tuple[int, int, bytes]:
        """The start tag anew, with attributes and first children."""
        tag = self._bytes[element.start : element.end].decode()
        for name, value in self._attributes.get(element, {}).items():
            tag = _with_attribute(tag, name, value)
        if lines := self._added.get(element):
            margin = self._margin(element)
            inner = "".join(f"\n{margin}  {line}" for line in lines)
            if tag.endswith("/>"):
                tag = f"{tag[:-2].rstrip()}>{inner}\n{margin}</{element.tag}>"
            else:
                tag += inner
        return element.start, element.end, tag.encode()

    def _margin(self, element: Element) -> str:
        """The blanks before an element in its line."""
        before = self._bytes[: element.start].decode()
        line = before[before.rfind("\n") + 1 :]
        return line[: len(line) - len(line.lstrip())]


def number(value: float) -> str:
    """A number as people write it, to ten digits; what is rounding alone is 0."""
    return f"{round(value, 13) + 0.0:.10g}"


def _with_attribute(tag: str, name: str, value: str) -> str:
    there = re.search(rf"(\s{re.escape(name)}\s*=\s*)(\"[^\"]*\"|'[^']*')", tag)
    if there:
        return tag[: there.start()] + there.group(1) + quoteattr(value) + tag[there.end() :]
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
        element.close = element.end if empty else at
        element.past = element.end if empty else text.index(b">", at) + 1

    parser.StartElementHandler, parser.EndElementHandler = start, end
    parser.Parse(text, True)
    return root[0]


def _tag_end(text: bytes, start: int) -> int:
    """Past the ``>`` of the tag that begins at ``start``; one in quotes does not count."""
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
