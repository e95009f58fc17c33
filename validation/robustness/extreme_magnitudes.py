"""MJCF models with extreme numbers: far too small, far too large, or denormal, in any attribute.

`with_extreme_magnitude` replaces a component of an attribute of a random element, or adds the attribute.
"""

import random
import re

# magnitudes at which squares, cubes or reciprocals overflow or underflow, and at which rounding starts
MAGNITUDES = (
    *("5e-324", "1e-320", "1e-300", "1e-200", "1e-160", "1e-120", "1e-80", "1e-40", "1e-16"),
    *("1e16", "1e40", "1e80", "1e120", "1e150", "1e160", "1e200", "1e300", "1.7e308"),
)
# element -> attribute -> valid numbers
ATTRIBUTES = {
    "joint": {
        "ref": "0",
        "springref": "0",
        "range": "-3 3",
        "pos": "0 0 0",
        "axis": "0 0 1",
        "stiffness": "0",
        "damping": "0",
        "armature": "0",
        "frictionloss": "0",
        "margin": "0",
    },
    "inertial": {"mass": "1", "diaginertia": "1e-4 1e-4 1e-4", "pos": "0 0 0"},
    "body": {"pos": "0 0 0", "quat": "1 0 0 0"},
    "site": {"pos": "0 0 0"},
    "connect": {"solref": "0.002 1", "solimp": "0.99 0.99 0.001 0.5 2"},
    "option": {"timestep": "1e-4", "gravity": "0 0 0", "tolerance": "1e-24", "impratio": "1"},
}


def with_extreme_magnitude(chance: random.Random, text: str) -> str:
    """Return a model with one number of extreme magnitude."""
    elements = [item for item in re.finditer(r"<(\w+)\b[^<>]*>", text) if item[1] in ATTRIBUTES]
    element = chance.choice(elements)
    name = chance.choice(list(ATTRIBUTES[element[1]]))
    number = chance.choice(("", "", "-")) + chance.choice(MAGNITUDES)
    present = re.search(rf'\s{name}="([^"]*)"', element[0])
    numbers = (present[1] if present else ATTRIBUTES[element[1]][name]).split()
    numbers[chance.randrange(len(numbers))] = number
    attribute = f'{name}="{" ".join(numbers)}"'
    if present:
        changed = element[0][: present.start(0) + 1] + attribute + element[0][present.end() :]
    else:
        end = -2 if element[0].endswith("/>") else -1
        changed = f"{element[0][:end].rstrip()} {attribute}{element[0][end:]}"
    return text[: element.start()] + changed + text[element.end() :]
