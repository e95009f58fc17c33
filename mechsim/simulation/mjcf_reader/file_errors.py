"""Errors about files in one line, with file and line number."""

import os
import re
from xml.parsers import expat

from mechsim.errors import InputError, cut

# maximum number of characters quoted from a message of MuJoCo
MAX_SHOWN = 300

_LINE = re.compile(r",?\s*line(?: number)?[ =:]+(\d+)", re.IGNORECASE)
_NOISE = re.compile(
    r"MuJoCo refuses the model: |(?:XML )?Error: |,? ?\bid -?\d+|Element name '',?"
    r"|ErrorID=\d+ \(0x[0-9a-f]+\)"
)
_PLUGIN = re.compile(r"plugin \S+ not found")
_NOT_INCLUDED = re.compile(r"Error opening file '(.+?)' Element 'include'")
# maximum nesting depth of MuJoCo's XML reader, and its error beyond that depth
MAX_DEPTH, _TOO_DEEP = 499, "XML_ELEMENT_DEPTH_EXCEEDED"
_ELEMENT = re.compile(r" Element (?:name )?('[^']*')")


def readable_error(path: str, error: Exception) -> InputError:
    """Return MuJoCo's error about a file in one line: file, line and message."""
    text = " ".join(str(error).split())
    if "XML parse error" in text and (ill_formed := _ill_formed(path)):
        return ill_formed
    line = _LINE.search(text)
    location = f"{path}, line {line[1]}" if line and int(line[1]) else path
    if include := _NOT_INCLUDED.search(text):
        folder, name = os.path.split(os.path.abspath(include[1]))
        return InputError(
            f"{location}: it includes {name}, which is not in {folder}; put it there, or correct the file"
        )
    if _TOO_DEEP in text:
        return InputError(
            f"{location}: elements are nested more than {MAX_DEPTH} deep, which MuJoCo's XML reader refuses; "
            "put the inner bodies into a file of their own and <include> it in their place"
        )
    message = " ".join(_NOISE.sub("", _LINE.sub("", text)).split()).strip(" ,;:")
    message = _ELEMENT.sub(r" (element \1)", message)
    message = cut(message, MAX_SHOWN)
    remedy = "take the plugin out of a copy" if _PLUGIN.search(message) else "correct the file"
    return InputError(f"{location}: MuJoCo refuses it: {message}; {remedy}")


def _ill_formed(path: str) -> InputError | None:
    """Return the position and cause of an XML error; None if the file is well-formed."""
    try:
        with open(path, "rb") as file:
            expat.ParserCreate().ParseFile(file)
    except expat.ExpatError as error:
        return InputError(
            f"{path}, line {error.lineno}, column {error.offset + 1}: no well-formed XML, "
            f"{expat.ErrorString(error.code)}; correct the file"
        )
    return None
