"""An MJCF text and the edits made to it: attributes set, elements added or taken away."""

from dataclasses import dataclass, field

from mechsim.simulation.mjcf_text.element_spans import Element, elements_of, value_span


@dataclass
class EditedText:
    """A text with edits that are made when it is asked for.

    Attributes:
        text: as it was.
        root: its elements.
        edits: (from, to, what stands there instead).
    """

    text: str
    root: Element = field(init=False)
    edits: list[tuple[int, int, str]] = field(default_factory=list[tuple[int, int, str]])

    def __post_init__(self) -> None:
        self.root = elements_of(self.text)

    @property
    def result(self) -> str:
        """The text with all edits made."""
        out = self.text
        for start, end, new in sorted(self.edits, key=lambda edit: edit[0], reverse=True):
            out = out[:start] + new + out[end:]
        return out

    def set(self, element: Element, name: str, value: str) -> None:
        """Give an element an attribute, in place of the value it has."""
        span = value_span(self.text, element, name)
        if span is not None:
            if self.text[slice(*span)] != value:
                self.edits.append((*span, value))
            return
        position = element.opened - (2 if self.text[element.opened - 2] == "/" else 1)
        while self.text[position - 1].isspace():
            position -= 1
        self.edits.append((position, position, f' {name}="{value}"'))

    def put_first(self, element: Element, new: str) -> None:
        """Add lines at the beginning of an element that is not empty."""
        self._put(element.opened, self._indent_in(element), new)

    def put_after(self, element: Element, new: str) -> None:
        """Add lines after an element, as far in as it is."""
        self._put(element.end, self._indent(element), new)

    def _put(self, position: int, indent: str, new: str) -> None:
        """Add lines at a place, what follows it in a line of its own."""
        line_goes_on = self.text[position : position + 1].strip() != ""
        lines = "".join(f"\n{indent}{line}" for line in new.split("\n"))
        self.edits.append((position, position, lines + (f"\n{indent}" if line_goes_on else "")))

    def put_last(self, element: Element, new: str) -> None:
        """Add lines at the end of an element that is not empty."""
        indent, position = self._indent_in(element), element.close
        while self.text[position - 1] in " \t":
            position -= 1
        own = self._indent(element)
        lines = "".join(f"{indent}{line}\n" for line in new.split("\n"))
        before = "" if self.text[position - 1] == "\n" else "\n"
        self.edits.append((position, element.close, before + lines + own))

    def take_away(self, element: Element) -> None:
        """Take an element away, with its line where nothing else stands in it."""
        start, end = element.start, element.end
        first, last = self.text.rfind("\n", 0, start) + 1, self.text.find("\n", end)
        last = len(self.text) if last < 0 else last
        if not self.text[first:start].strip() and not self.text[end:last].strip():
            start, end = first, min(last + 1, len(self.text))
        self.edits.append((start, end, ""))

    def _indent(self, element: Element) -> str:
        """Return the white space before an element in its line; nothing where something else stands there."""
        before = self.text[self.text.rfind("\n", 0, element.start) + 1 : element.start]
        return before if not before.strip() else ""

    def _indent_in(self, element: Element) -> str:
        """Return the white space with which children of an element begin their lines."""
        own = self._indent(element)
        for child in element.children:
            if "\n" in self.text[element.opened : child.start]:
                indent = self._indent(child)
                return indent if indent or not own else own + "  "
        return own + "  "
