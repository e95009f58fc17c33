"""MJCF with a number of an odd magnitude: far too small, far too large, denormal, where it may stand at all.

`odd` gives an attribute of a random element such a number, as one of its components, or adds it.
"""

import random
import re

# what squares, cubes or reciprocals of a number end beyond what a float holds; and where rounding begins
MAGNITUDES = (
    *("5e-324", "1e-320", "1e-300", "1e-200", "1e-160", "1e-120", "1e-80", "1e-40", "1e-16"),
    *("1e16", "1e40", "1e80", "1e120", "1e150", "1e160", "1e200", "1e300", "1.7e308"),
)
# element -> attribute, and the numbers that make it a sound one
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


def odd(chance: random.Random, text: str) -> str:
    """Return a model with a number of an odd magnitude in it."""
    result = [item for item in re.finditer(r"<(\w+)\b[^<>]*>", text) if item[1] in ATTRIBUTES]
    element = chance.choice(result)
    name = chance.choice(list(ATTRIBUTES[element[1]]))
    odd = chance.choice(("", "", "-")) + chance.choice(MAGNITUDES)
    there = re.search(rf'\s{name}="([^"]*)"', element[0])
    numbers = (there[1] if there else ATTRIBUTES[element[1]][name]).split()
    numbers[chance.randrange(len(numbers))] = odd
    given = f'{name}="{" ".join(numbers)}"'
    if there:
        made = element[0][: there.start(0) + 1] + given + element[0][there.end() :]
    else:
        end = -2 if element[0].endswith("/>") else -1
        made = f"{element[0][:end].rstrip()} {given}{element[0][end:]}"
    return text[: element.start()] + made + text[element.end() :]
