"""An MJCF text and edits of it: attributes set, elements added or removed."""

import re
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from xml.parsers import expat

import numpy as np

from mechsim.errors import InputError

# a start tag; a `>` in a value does not end it
_TAG = re.compile(r"""<(?:[^>"']|"[^"]*"|'[^']*')*>""")
_ATTRIBUTE = re.compile(r"""([\w:.-]+)\s*=\s*("[^"]*"|'[^']*')""")


@dataclass
class Element:
    """An element and its position in the text.

    Attributes:
        tag: name of the element.
        attributes: name -> value.
        start: index of its `<`.
        opened: index after the `>` of its start tag.
        close: index of the `<` of its end tag; `opened` for an empty element.
        end: index after the element.
        parent: the enclosing element; None for the root.
        children: enclosed elements, in order.
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
        """Whether the element consists of its start tag only."""
        return self.close == self.end

    def tagged(self, *tags: str) -> list["Element"]:
        """Return the children with one of these tags."""
        return [child for child in self.children if child.tag in tags]

    def every(self, *tags: str) -> Iterator["Element"]:
        """Yield the elements at all depths in the order of the text, with these tags if any are given."""
        for child in self.children:
            if not tags or child.tag in tags:
                yield child
            yield from child.every(*tags)

    def within(self, tag: str) -> "Element | None":
        """Return the innermost enclosing element with a tag."""
        above = self.parent
        while above is not None and above.tag != tag:
            above = above.parent
        return above


def elements_of(text: str, where: str = "the text") -> Element:
    """Return the root of an XML text.

    Raises:
        InputError: for text that is not XML.
    """
    data, parser = text.encode(), expat.ParserCreate("utf-8")
    stack, roots = list[Element](), list[Element]()
    # the parser counts bytes; in UTF-8 all bytes but the first of a character are 10xxxxxx
    starts = np.cumsum((np.frombuffer(data, np.uint8) & 0b11000000) != 0b10000000)

    def index_of(byte: int) -> int:
        return int(starts[byte]) - 1

    def started(tag: str, attributes: dict[str, str]) -> None:
        start, parent = index_of(parser.CurrentByteIndex), stack[-1] if stack else None
        whole = _TAG.match(text, start)
        if whole is None:
            raise InputError(
                f"{where}, line {parser.CurrentLineNumber}: MuJoCo does not read the entity that stands for "
                f"<{tag}>; write its text in its place"
            )
        element = Element(tag, attributes, start, opened=whole.end(), parent=parent)
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
        raise InputError(f"{where} is not XML: {error}; correct it") from None
    return roots[0]


def value_span(text: str, element: Element, name: str) -> tuple[int, int] | None:
    """Return start and end of the value of an attribute between its quotes; None without the attribute."""
    for match in _ATTRIBUTE.finditer(text, element.start, element.opened):
        if match[1] == name:
            return match.start(2) + 1, match.end(2) - 1
    return None


@dataclass
class EditedText:
    """A text with edits that are applied when the result is requested.

    Attributes:
        text: the original text.
        root: its elements.
        edits: (start, end, replacement).
    """

    text: str
    root: Element = field(init=False)
    edits: list[tuple[int, int, str]] = field(default_factory=list[tuple[int, int, str]])

    def __post_init__(self) -> None:
        self.root = elements_of(self.text)

    @property
    def result(self) -> str:
        """The text with all edits."""
        out = self.text
        for start, end, new in sorted(self.edits, key=lambda edit: edit[0], reverse=True):
            out = out[:start] + new + out[end:]
        return out

    def set(self, element: Element, name: str, value: str) -> None:
        """Set an attribute of an element."""
        span = value_span(self.text, element, name)
        if span is not None:
            if self.text[slice(*span)] != value:
                self.edits.append((*span, value))
            return
        position = element.opened - (2 if self.text[element.opened - 2] == "/" else 1)
        while self.text[position - 1].isspace():
            position -= 1
        self.edits.append((position, position, f' {name}="{value}"'))

    def set_all(self, element: Element, values: Mapping[str, str]) -> None:
        """Set attributes of an element."""
        for name, value in values.items():
            self.set(element, name, value)

    def put_first(self, element: Element, new: str) -> None:
        """Add lines at the beginning of an element that is not empty."""
        self._put(element.opened, self._indent_in(element), new)

    def put_after(self, element: Element, new: str) -> None:
        """Add lines after an element with the same indentation."""
        self._put(element.end, self._indent(element), new)

    def _put(self, position: int, indent: str, new: str) -> None:
        """Add lines at a position; the text after it starts a new line."""
        line_continues = self.text[position : position + 1].strip() != ""
        lines = "".join(f"\n{indent}{line}" for line in new.split("\n"))
        self.edits.append((position, position, lines + (f"\n{indent}" if line_continues else "")))

    def put_last(self, element: Element, new: str) -> None:
        """Add lines at the end of an element that is not empty."""
        indent, position = self._indent_in(element), element.close
        while self.text[position - 1] in " \t":
            position -= 1
        own = self._indent(element)
        lines = "".join(f"{indent}{line}\n" for line in new.split("\n"))
        before = "" if self.text[position - 1] == "\n" else "\n"
        self.edits.append((position, element.close, before + lines + own))

    def remove(self, element: Element) -> None:
        """Remove an element, and its line if that is then empty."""
        start, end = element.start, element.end
        first, last = self.text.rfind("\n", 0, start) + 1, self.text.find("\n", end)
        last = len(self.text) if last < 0 else last
        if not self.text[first:start].strip() and not self.text[end:last].strip():
            start, end = first, min(last + 1, len(self.text))
        self.edits.append((start, end, ""))

    def _indent(self, element: Element) -> str:
        """Return the white space before an element in its line; empty if other text precedes it."""
        before = self.text[self.text.rfind("\n", 0, element.start) + 1 : element.start]
        return before if not before.strip() else ""

    def _indent_in(self, element: Element) -> str:
        """Return the indentation of the children of an element."""
        own = self._indent(element)
        for child in element.children:
            if "\n" in self.text[element.opened : child.start]:
                indent = self._indent(child)
                return indent if indent or not own else own + "  "
        return own + "  "


# largest number of rows without an attribute that get it one by one; more get it from a default
MAX_REPEATED = 2


def set_options(edited: EditedText, options: Mapping[str, str], flags: Mapping[str, bool]) -> None:
    """Set options and flags in the elements that have them, else in the last `option` or a new one."""
    sections = edited.root.tagged("option")
    flag_elements = [element for section in sections for element in section.tagged("flag")]
    words = {name: "enable" if on else "disable" for name, on in flags.items()}
    options = _set_where_present(edited, sections, options)
    words = _set_where_present(edited, flag_elements, words)
    if words and flag_elements:
        edited.set_all(flag_elements[-1], words)
        words = {}
    flag = f"<flag{_attributes(words)}/>" if words else ""
    if sections and not (flag and sections[-1].empty):
        edited.set_all(sections[-1], options)
        if flag:
            edited.put_first(sections[-1], flag)
    elif options or flag:
        head = f"<option{_attributes(options)}"
        _put_section(edited, f"{head}>{flag}</option>" if flag else f"{head}/>", ("compiler", "option"))


def _set_where_present(
    edited: EditedText, elements: Sequence[Element], values: Mapping[str, str]
) -> dict[str, str]:
    """Set each attribute in the last element that has it; return those that no element has."""
    remaining: dict[str, str] = {}
    for name, value in values.items():
        holders = [element for element in elements if name in element.attributes]
        if holders:
            edited.set(holders[-1], name, value)
        else:
            remaining[name] = value
    return remaining


def _put_section(edited: EditedText, text: str, after: Sequence[str]) -> None:
    """Add a section after the last one with one of these tags, or as the first."""
    if before := edited.root.tagged(*after):
        edited.put_after(before[-1], text)
    else:
        edited.put_first(edited.root, text)


def _attributes(values: Mapping[str, str]) -> str:
    return "".join(f' {name}="{value}"' for name, value in values.items())


def equality_elements(root: Element) -> list[Element]:
    """Return the equality constraints of a text in order."""
    return [equality for section in root.tagged("equality") for equality in section.children]


def set_compliance(edited: EditedText, values: Mapping[str, str]) -> None:
    """Give all equality constraints the same compliance (solref, solimp)."""
    equalities = equality_elements(edited.root)
    plain: list[str] = []
    for name, value in values.items():
        unset = [equality for equality in equalities if not {name, "class"} & equality.attributes.keys()]
        by_default = unset and (len(unset) > MAX_REPEATED or _default(edited.root) is not None)
        for equality in equalities:
            if equality not in unset or not by_default:
                edited.set(equality, name, value)
        if by_default:
            plain.append(name)
    if plain:
        _set_default(edited, {name: values[name] for name in plain})


def _main_defaults(root: Element) -> Sequence[Element]:
    sections = root.tagged("default")
    return [section for section in sections if section.attributes.get("class", "main") == "main"]


def _default(root: Element) -> Element | None:
    """Return the `equality` element of the main default; None without one."""
    defaults = [element for section in _main_defaults(root) for element in section.tagged("equality")]
    return defaults[-1] if defaults else None


def _set_default(edited: EditedText, values: Mapping[str, str]) -> None:
    default, sections = _default(edited.root), _main_defaults(edited.root)
    new = f"<equality{_attributes(values)}/>"
    if default is not None:
        edited.set_all(default, values)
    elif sections and not sections[-1].empty:
        edited.put_first(sections[-1], new)
    else:
        _put_section(edited, f"<default>{new}</default>", ("compiler", "option", "size", "statistic"))


def put_comment(edited: EditedText, lines: Sequence[str]) -> None:
    """Add a comment at the beginning of the model."""
    text = "\n     ".join(line.replace("--", "- -") for line in lines)
    edited.put_first(edited.root, f"<!-- {text} -->")


def put_key(edited: EditedText, name: str, states: Mapping[str, str]) -> None:
    """Add a keyframe."""
    section = [element for element in edited.root.tagged("keyframe") if not element.empty]
    new = f'<key name="{name}"{_attributes(states)}/>'
    if section:
        edited.put_last(section[-1], new)
    else:
        edited.put_last(edited.root, f"<keyframe>\n  {new}\n</keyframe>")
