"""Settings of a scene written into its MJCF text in as few places as there are."""

from collections.abc import Mapping, Sequence

from mechsim.simulation.mjcf_text.edited_text import EditedText
from mechsim.simulation.mjcf_text.element_spans import Element

# so many rows without an attribute of their own are served by one default
FEW = 2


def set_options(edited: EditedText, options: Mapping[str, str], flags: Mapping[str, bool]) -> None:
    """Set options and flags: where the text has them, else in its last `option`, else in a new one."""
    sections = [one for one in edited.root.children if one.tag == "option"]
    left = dict(options)
    for name, value in options.items():
        having = [one for one in sections if name in one.attributes]
        if having:
            edited.set(having[-1], name, value)
            del left[name]
    words = {name: "enable" if on else "disable" for name, on in flags.items()}
    known = [one for section in sections for one in section.children if one.tag == "flag"]
    for name in list(words):
        having = [one for one in known if name in one.attributes]
        if having:
            edited.set(having[-1], name, words.pop(name))
    if words and known:
        for name, word in words.items():
            edited.set(known[-1], name, word)
        words = {}
    if left and sections and not words:
        for name, value in left.items():
            edited.set(sections[-1], name, value)
        return
    if not left and not words:
        return
    flag = f"<flag{_attributes(words)}/>" if words else ""
    if sections and not sections[-1].empty:
        for name, value in left.items():
            edited.set(sections[-1], name, value)
        edited.put_first(sections[-1], flag)
        return
    new = f"<option{_attributes(left)}>{flag}</option>" if flag else f"<option{_attributes(left)}/>"
    heads = [one for one in edited.root.children if one.tag in ("compiler", "option")]
    if heads:
        edited.put_after(heads[-1], new)
    else:
        edited.put_first(edited.root, new)


def _attributes(values: Mapping[str, str]) -> str:
    return "".join(f' {name}="{value}"' for name, value in values.items())


def rows_of(root: Element) -> list[Element]:
    """Return the equality constraints of a text, in its order."""
    return [one for section in root.children if section.tag == "equality" for one in section.children]


def set_softness(edited: EditedText, values: Mapping[str, str]) -> None:
    """Give all equality constraints the same softness."""
    rows = rows_of(edited.root)
    plain: list[str] = []
    for name, value in values.items():
        bare = [row for row in rows if name not in row.attributes and "class" not in row.attributes]
        for row in rows:
            if row not in bare:
                edited.set(row, name, value)
        if len(bare) <= FEW and _default(edited.root) is None:
            for row in bare:
                edited.set(row, name, value)
        elif bare:
            plain.append(name)
    if plain:
        _set_default(edited, {name: values[name] for name in plain})


def _main_defaults(root: Element) -> Sequence[Element]:
    return [
        one for one in root.children if one.tag == "default" and one.attributes.get("class", "main") == "main"
    ]


def _default(root: Element) -> Element | None:
    """Return what the main default says of equality constraints; None where it says nothing."""
    found = [one for section in _main_defaults(root) for one in section.children if one.tag == "equality"]
    return found[-1] if found else None


def _set_default(edited: EditedText, values: Mapping[str, str]) -> None:
    known, sections = _default(edited.root), _main_defaults(edited.root)
    if known is not None:
        for name, value in values.items():
            edited.set(known, name, value)
        return
    new = f"<equality{_attributes(values)}/>"
    if sections and not sections[-1].empty:
        edited.put_first(sections[-1], new)
        return
    heads = [one for one in edited.root.children if one.tag in ("compiler", "option", "size", "statistic")]
    if heads:
        edited.put_after(heads[-1], f"<default>{new}</default>")
    else:
        edited.put_first(edited.root, f"<default>{new}</default>")


def put_comment(edited: EditedText, lines: Sequence[str]) -> None:
    """Say something at the beginning of the model."""
    said = "\n     ".join(line.replace("--", "- -") for line in lines)
    edited.put_first(edited.root, f"<!-- {said} -->")


def put_key(edited: EditedText, name: str, states: Mapping[str, str]) -> None:
    """Add a keyframe."""
    section = [one for one in edited.root.children if one.tag == "keyframe" and not one.empty]
    new = f'<key name="{name}"{_attributes(states)}/>'
    if section:
        edited.put_last(section[-1], new)
    else:
        edited.put_last(edited.root, f"<keyframe>\n  {new}\n</keyframe>")
