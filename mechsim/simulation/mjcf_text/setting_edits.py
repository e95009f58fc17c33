"""Settings of a scene written into its MJCF text in as few places as there are."""

from collections.abc import Mapping, Sequence

from mechsim.simulation.mjcf_text.edited_text import EditedText
from mechsim.simulation.mjcf_text.element_spans import Element

# so many rows without an attribute of their own are served by one default
MAX_REPEATED = 2


def set_options(edited: EditedText, options: Mapping[str, str], flags: Mapping[str, bool]) -> None:
    """Set options and flags: where the text has them, else in its last `option`, else in a new one."""
    sections = [element for element in edited.root.children if element.tag == "option"]
    remaining = dict(options)
    for name, value in options.items():
        holders = [element for element in sections if name in element.attributes]
        if holders:
            edited.set(holders[-1], name, value)
            del remaining[name]
    states = {name: "enable" if on else "disable" for name, on in flags.items()}
    flag_elements = [element for section in sections for element in section.children if element.tag == "flag"]
    for name in list(states):
        holders = [element for element in flag_elements if name in element.attributes]
        if holders:
            edited.set(holders[-1], name, states.pop(name))
    if states and flag_elements:
        for name, word in states.items():
            edited.set(flag_elements[-1], name, word)
        states = {}
    if remaining and sections and not states:
        for name, value in remaining.items():
            edited.set(sections[-1], name, value)
        return
    if not remaining and not states:
        return
    flag = f"<flag{_attributes(states)}/>" if states else ""
    if sections and not sections[-1].empty:
        for name, value in remaining.items():
            edited.set(sections[-1], name, value)
        edited.put_first(sections[-1], flag)
        return
    new = f"<option{_attributes(remaining)}>{flag}</option>" if flag else f"<option{_attributes(remaining)}/>"
    heads = [element for element in edited.root.children if element.tag in ("compiler", "option")]
    if heads:
        edited.put_after(heads[-1], new)
    else:
        edited.put_first(edited.root, new)


def _attributes(values: Mapping[str, str]) -> str:
    return "".join(f' {name}="{value}"' for name, value in values.items())


def equality_elements(root: Element) -> list[Element]:
    """Return the equality constraints of a text, in its order."""
    return [
        equality for section in root.children if section.tag == "equality" for equality in section.children
    ]


def set_compliance(edited: EditedText, values: Mapping[str, str]) -> None:
    """Give all equality constraints the same compliance (solref, solimp)."""
    equalities = equality_elements(edited.root)
    plain: list[str] = []
    for name, value in values.items():
        unset = [
            equality
            for equality in equalities
            if name not in equality.attributes and "class" not in equality.attributes
        ]
        for equality in equalities:
            if equality not in unset:
                edited.set(equality, name, value)
        if len(unset) <= MAX_REPEATED and _default(edited.root) is None:
            for equality in unset:
                edited.set(equality, name, value)
        elif unset:
            plain.append(name)
    if plain:
        _set_default(edited, {name: values[name] for name in plain})


def _main_defaults(root: Element) -> Sequence[Element]:
    return [
        section_
        for section_ in root.children
        if section_.tag == "default" and section_.attributes.get("class", "main") == "main"
    ]


def _default(root: Element) -> Element | None:
    """Return what the main default says of equality constraints; None where it says nothing."""
    defaults = [
        element
        for section in _main_defaults(root)
        for element in section.children
        if element.tag == "equality"
    ]
    return defaults[-1] if defaults else None


def _set_default(edited: EditedText, values: Mapping[str, str]) -> None:
    default, sections = _default(edited.root), _main_defaults(edited.root)
    if default is not None:
        for name, value in values.items():
            edited.set(default, name, value)
        return
    new = f"<equality{_attributes(values)}/>"
    if sections and not sections[-1].empty:
        edited.put_first(sections[-1], new)
        return
    heads = [
        element
        for element in edited.root.children
        if element.tag in ("compiler", "option", "size", "statistic")
    ]
    if heads:
        edited.put_after(heads[-1], f"<default>{new}</default>")
    else:
        edited.put_first(edited.root, f"<default>{new}</default>")


def put_comment(edited: EditedText, lines: Sequence[str]) -> None:
    """Say something at the beginning of the model."""
    text = "\n     ".join(line.replace("--", "- -") for line in lines)
    edited.put_first(edited.root, f"<!-- {text} -->")


def put_key(edited: EditedText, name: str, states: Mapping[str, str]) -> None:
    """Add a keyframe."""
    section = [element for element in edited.root.children if element.tag == "keyframe" and not element.empty]
    new = f'<key name="{name}"{_attributes(states)}/>'
    if section:
        edited.put_last(section[-1], new)
    else:
        edited.put_last(edited.root, f"<keyframe>\n  {new}\n</keyframe>")
