"""The elements of an XML text, each with where it stands in the text."""

import re
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from xml.parsers import expat

from mechsim.errors import InputError

_ATTRIBUTE = re.compile(r"""([\w:.-]+)\s*=\s*("[^"]*"|'[^']*')""")


@dataclass
class Element:
    """An element and where it stands.

    Attributes:
        tag: its name.
        attributes: name -> value.
        start: index of its `<`.
        opened: index after the `>` of its start tag.
        close: index of the `<` of its end tag; `opened` where the start tag closes it, too.
        end: index after it.
        parent: around it; None of the root.
        children: in it, in order.
    """

    tag: str
    attributes: dict[str, str]
    start: int
    opened: int = 0
    close: int = 0
    end: int = 0
    parent: "Element | None" = field(default=None, repr=False)
    children: list["Element"] = field(default_factory=list["Element"], repr=False)

    @property
    def empty(self) -> bool:
        """Whether its start tag is all of it."""
        return self.close == self.end

    def every(self, *tags: str) -> Iterator["Element"]:
        """Yield the elements in it, all depths, in the order of the text, of these tags if any are named."""
        for child in self.children:
            if not tags or child.tag in tags:
                yield child
            yield from child.every(*tags)

    def within(self, tag: str) -> "Element | None":
        """Return the nearest element around it of a tag."""
        above = self.parent
        while above is not None and above.tag != tag:
            above = above.parent
        return above


def elements_of(text: str, where: str = "the text") -> Element:
    """Return the root of an XML text.

    Raises:
        InputError: for what is no XML.
    """
    data = text.encode()
    # bytes are what the parser counts
    index_of = _indices(text, data)
    stack: list[Element] = []
    roots: list[Element] = []
    parser = expat.ParserCreate("utf-8")

    def started(tag: str, attributes: dict[str, str]) -> None:
        start = index_of(parser.CurrentByteIndex)
        element = Element(
            tag, attributes, start, opened=_tag_end(text, start), parent=stack[-1] if stack else None
        )
        (stack[-1].children if stack else roots).append(element)
        stack.append(element)

    def ended(_: str) -> None:
        element = stack.pop()
        if text[element.opened - 2] == "/":
            element.close = element.end = element.opened
        else:
            element.close = index_of(parser.CurrentByteIndex)
            element.end = text.index(">", element.close) + 1

    parser.StartElementHandler, parser.EndElementHandler = started, ended
    try:
        parser.Parse(data, True)
    except expat.ExpatError as error:
        raise InputError(f"{where} is no XML: {error}; mend it") from None
    return roots[0]


def _indices(text: str, data: bytes) -> Callable[[int], int]:
    """Return what gives the index of a character from that of its byte."""
    plain = len(data) == len(text)
    return lambda byte: byte if plain else len(data[:byte].decode())


def _tag_end(text: str, start: int) -> int:
    """Return the index after the `>` of the tag that starts somewhere; one in a value does not end it."""
    quote, i = "", start
    while True:
        character = text[i]
        if quote:
            quote = "" if character == quote else quote
        elif character in "\"'":
            quote = character
        elif character == ">":
            return i + 1
        i += 1


def value_span(text: str, element: Element, name: str) -> tuple[int, int] | None:
    """Return where the value of an attribute stands between its quotes; None where it has none."""
    for match in _ATTRIBUTE.finditer(text, element.start, element.opened):
        if match[1] == name:
            return match.start(2) + 1, match.end(2) - 1
    return None
