"""Random mechanisms as TOML, each drawn around an assembled pose: what `random_toml_mechanisms.py` asks.

Links stand anywhere; joints are put between them with coordinates of any value, in chains that close loops:
spatial, planar in a tilted plane, or spherical. Gears, racks and polynomials couple coordinates at the values
that they have. Drivers are drawn among the coordinates that can be driven so that nothing stays open but rods
that spin between balls, by the rank of equations that are not mechsim's.
"""

from dataclasses import dataclass

import numpy as np
from maximal_coordinates import FREEDOMS, NOUGHT, UNITS, DynamicModel, Joint, Program

DRIVABLE = ("revolute", "prismatic", "cylindrical")
LENGTHS = {"m": 1.0, "mm": 1e-3, "cm": 1e-2, "inch": 0.0254}
ANGLES = {"rad": 1.0, "deg": np.pi / 180}
SPATIAL = [*FREEDOMS][1:]


@dataclass
class Drawn:
    """A mechanism, its truth, and what is asked of it."""

    text: str
    machine: DynamicModel
    pose: np.ndarray
    names: list[str]  # of all coordinates
    units: list[str]  # of these: r or m
    columns: list[str]  # their columns in a table, with * for q, v or a
    drivers: list[int]
    swings: list[float]
    guess: str
    what: str


def turn(axis: np.ndarray, angle: float) -> np.ndarray:
    """Return the matrix of a turn about an axis."""
    x, y, z = axis / np.linalg.norm(axis)
    cross = np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])
    return np.eye(3) + np.sin(angle) * cross + (1 - np.cos(angle)) * cross @ cross


def quaternion(matrix: np.ndarray) -> np.ndarray:
    """Return the quaternion of a turning matrix: w, x, y, z."""
    m = matrix
    k = np.array(
        [
            [m[0, 0] + m[1, 1] + m[2, 2], m[2, 1] - m[1, 2], m[0, 2] - m[2, 0], m[1, 0] - m[0, 1]],
            [m[2, 1] - m[1, 2], m[0, 0] - m[1, 1] - m[2, 2], m[0, 1] + m[1, 0], m[0, 2] + m[2, 0]],
            [m[0, 2] - m[2, 0], m[0, 1] + m[1, 0], m[1, 1] - m[0, 0] - m[2, 2], m[1, 2] + m[2, 1]],
            [m[1, 0] - m[0, 1], m[0, 2] + m[2, 0], m[1, 2] + m[2, 1], m[2, 2] - m[0, 0] - m[1, 1]],
        ]
    )
    return np.linalg.eigh(k)[1][:, -1]


def displaced(joint: Joint, q: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return where b's frame stands in a's at given coordinates; of a ball, anywhere."""
    x, y, z = np.eye(3)
    if joint.kind == "universal":
        # at zero b's axis leans from a's axis towards a's reference, and b's reference on to a's axis
        tilt = turn(y, joint.cross) @ turn(z, np.pi)
        return 0 * z, turn(z, q[0]) @ tilt @ turn(z, q[1])
    shift = {"planar": lambda: q[0] * x + q[1] * y}.get(joint.kind, lambda: q[0] * z)
    slides = UNITS[joint.kind].startswith("m")
    return shift() if slides else 0 * z, turn(z, q[-1]) if UNITS[joint.kind].endswith("r") else np.eye(3)


class Sketch:
    """Links at random places, and chains of joints between them."""

    def __init__(self, chance: np.random.Generator) -> None:
        self.chance = chance
        self.mode = str(chance.choice(["spatial", "planar", "spherical"], p=[0.5, 0.35, 0.15]))
        self.size = float(10 ** chance.uniform(-2, 0))
        self.frame = self.any_turn()
        self.places, self.turns = [np.zeros(3)], [np.eye(3)]
        self.joints: list[Joint] = []
        self.q: list[float] = []

    def any_turn(self) -> np.ndarray:
        result = np.linalg.qr(self.chance.normal(size=(3, 3)))[0]
        return result * np.linalg.det(result)

    def kinds(self, freedoms: int) -> list[str]:
        """Return kinds of joints of a chain that have so many degrees of freedom in all."""
        result: list[str] = []
        while freedoms:
            if self.mode == "spatial":
                fits = [kind for kind in SPATIAL if FREEDOMS[kind] <= freedoms]
            elif self.mode == "planar":
                fits = ["revolute", "revolute", "revolute", "prismatic"]
            else:
                fits = ["revolute", "revolute", "universal"][: 2 if freedoms == 1 else 3]
            result.append(str(self.chance.choice(fits)))
            freedoms -= FREEDOMS[result[-1]]
        looser = {"planar": ["cylindrical", "spherical"], "spherical": ["spherical"]}.get(self.mode)
        for i, kind in enumerate(result):
            if looser and kind == "revolute" and self.chance.random() < 0.12:
                result[i] = str(self.chance.choice(looser))
        if self.chance.random() < 0.1:
            result.insert(int(self.chance.integers(len(result) + 1)), "fixed")
        return [str(item) for item in self.chance.permutation(result)]

    def chain(self, kinds: list[str], first: int, last: int) -> None:
        """Join two links by new ones."""
        at = first
        for i, kind in enumerate(kinds):
            if i < len(kinds) - 1:
                self.places.append(self.size * self.chance.uniform(-1, 1, 3))
                self.turns.append(self.any_turn())
                to = len(self.places) - 1
            else:
                to = last
            self.joint(kind, *((at, to) if self.chance.random() < 0.7 else (to, at)))
            at = to

    def joint(self, kind: str, a: int, b: int) -> None:
        """Put a joint between two links, as they stand."""
        chance = self.chance
        point = self.size * chance.uniform(-1, 1, 3) * (self.mode != "spherical")
        axes = self.any_turn()
        if self.mode == "planar":
            flat = turn(np.array([0, 0, 1.0]), chance.uniform(-3, 3))
            axes = self.frame @ flat @ (np.eye(3)[[2, 0, 1]] if kind == "prismatic" else np.eye(3))
        made = Joint(f"j{len(self.joints)}", kind, a, b, (point, axes), (point, axes), at=len(self.q))
        q = [float(chance.uniform(-0.4, 0.4) * (self.size if u == "m" else 6.0)) for u in UNITS[kind]]
        if kind == "universal" and chance.random() < 0.3:
            made.cross = float(chance.uniform(0.6, 2.5))
        if kind == "screw":
            made.lead = float(chance.uniform(0.2, 1.0) * self.size)
            q[0] = made.lead * q[1] / (2 * np.pi)
        shift, rel = displaced(made, np.array(q)) if kind != "spherical" else (np.zeros(3), self.any_turn())
        made.frame_a = self.in_link(a, point, axes)
        made.frame_b = self.in_link(b, point + axes @ shift, axes @ rel)
        self.joints.append(made)
        self.q += q

    def in_link(self, link: int, point: np.ndarray, axes: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        back = self.turns[link].T
        return back @ (point - self.places[link]), back @ axes


def drawn(seed: int) -> Drawn | None:
    """Return a mechanism, or None where what was drawn cannot be driven soundly."""
    chance = np.random.default_rng(seed)
    sketch = Sketch(chance)
    need = 6 if sketch.mode == "spatial" else 3
    freedoms = int(chance.choice([1, 2, 3], p=[0.55, 0.3, 0.15]))
    sketch.chain(sketch.kinds(need + freedoms), 0, 0)
    for _ in range(int(chance.choice([0, 1, 2], p=[0.5, 0.35, 0.15]))):
        first, last = chance.choice(len(sketch.places), 2, replace=False)
        sketch.chain(sketch.kinds(need + int(chance.choice([0, 0, 1]))), int(first), int(last))
    n = len(sketch.places) - 1
    machine = DynamicModel(n, sketch.size, sketch.joints)
    places = np.ravel(sketch.places[1:]) / sketch.size
    pose = np.concatenate([places, *map(quaternion, sketch.turns[1:]), sketch.q])
    names, columns, units, drivable = [], [], [], []
    for item in sketch.joints:
        kind = UNITS[item.kind]
        ends = {1: [""], 2: [".way", ".turn"], 3: [".x", ".y", ".turn"]}.get(len(kind), [])
        ends = [".1", ".2"] if item.kind == "universal" else ends
        names += [item.name + end for end in ends]
        columns += [f"{item.name}.*{i if len(kind) > 1 else ''}" for i in range(len(kind))]
        units += kind
        drivable += [item.kind in DRIVABLE] * len(kind)
    if np.abs(machine.residual(pose, 0.0)).max() > 1e-12:
        raise AssertionError(f"seed {seed}: what was drawn does not stand closed")
    open_ways = null(machine, pose)[:, 7 * n :]
    couplings: list[str] = []
    while np.linalg.matrix_rank(open_ways, 1e-6) > 1 and chance.random() < 0.35:
        made = coupled(chance, names, units, sketch, len(couplings))
        machine.couplings.append(made[1])
        open_ways = null(machine, pose)[:, 7 * n :]
        couplings.append(made[0])
    drivers: list[int] = []
    for i in chance.permutation(np.flatnonzero(drivable)):
        if np.linalg.norm(open_ways[:, i]) > 0.05 and len(open_ways):
            drivers.append(int(i))
            direction = open_ways[:, i : i + 1] / np.linalg.norm(open_ways[:, i])
            open_ways = open_ways - direction @ (direction.T @ open_ways)
    if not drivers or len(drivers) > 3 or np.abs(open_ways).max(initial=0.0) > 1e-8:
        return None
    for i in drivers:
        machine.driven[i] = constant(sketch.q[i])
    guess = str(chance.choice(["whole", "part", "none"], p=[0.5, 0.25, 0.25]))
    text = written(chance, sketch, [names[i] for i in drivers], names, units, couplings, guess)
    reach = [1.0 if units[i] == "r" else 0.4 * sketch.size for i in drivers]
    kinds = "".join(KIND_LETTERS[item.kind] for item in sketch.joints)
    what = f"{sketch.mode} {kinds}{f' {len(couplings)} coupled' if couplings else ''} of {len(drivers)}"
    return Drawn(text, machine, pose, names, units, columns, drivers, reach, guess, what)


KIND_LETTERS = {
    "fixed": "F",
    "revolute": "R",
    "prismatic": "P",
    "screw": "H",
    "cylindrical": "C",
    "universal": "U",
    "planar": "E",
    "spherical": "S",
}


def constant(value: float) -> Program:
    return lambda t: value


def null(machine: DynamicModel, pose: np.ndarray) -> np.ndarray:
    """Return the motions that nothing holds, (k, unknowns)."""
    values, right = np.linalg.svd(machine.jacobian(pose, 0.0))[1:]
    return right[int((values > NOUGHT * values[0]).sum()) :]


def coupled(chance, names, units, sketch, count):
    """Return a coupling of two coordinates, or a sum of two and a third, as text and as an equation."""
    of = [int(i) for i in chance.permutation(len(names))[:3]]
    q = [sketch.q[i] for i in of]
    item, two, three = of
    head = f'[couplings.c{count}]\ndriver = "{names[item]}"\n'
    kind = units[item] + units[two]
    if kind in ("rm", "mr") and chance.random() < 0.6:
        radius = float(chance.uniform(0.2, 0.6) * sketch.size * chance.choice([-1, 1]))
        gradient = radius if kind == "rm" else 1 / radius
        phase = q[1] - gradient * q[0]
        text = f'driven = "{names[two]}"\nradius = "{radius!r} m"\nphase = "{phase!r} {SI[units[two]]}"\n'
        return head + text, lambda x: x[..., two] - gradient * x[..., item] - phase
    if kind == "rr" and chance.random() < 0.6:
        ratio = float(chance.uniform(0.4, 2.0) * chance.choice([-1, 1]))
        phase = q[1] - ratio * q[0]
        text = f'driven = "{names[two]}"\nratio = {ratio!r}\nphase = "{phase!r} rad"\n'
        return head + text, lambda x: x[..., two] - ratio * x[..., item] - phase
    scale = [sketch.size if units[i] == "m" else 1.0 for i in of]
    slopes = chance.uniform(-0.6, 0.6, int(chance.integers(1, 4)))
    powers = [float(c * scale[1] / scale[0] ** (i + 1)) for i, c in enumerate(slopes)]
    bent = sum(c * q[0] ** (i + 1) for i, c in enumerate(powers))
    extra = units[three] == units[two] and len(names) > 2
    first = q[1] + 0.7 * extra * q[2] - bent
    # of a single coordinate the constant has its unit; derivatives are in the file's units, here SI
    listed = ", ".join(repr(c) for c in [first, *powers])
    driven = f'{{ "{names[two]}" = 1, "{names[three]}" = 0.7 }}' if extra else f'"{names[two]}"'
    text = f"driven = {driven}\ncoefficients = [{listed}]\n"

    def law(x: np.ndarray) -> np.ndarray:
        right = sum(c * x[..., item] ** (i + 1) for i, c in enumerate(powers))
        return x[..., two] + 0.7 * extra * x[..., three] - first - right

    return head + text, law


SI = {"m": "m", "r": "rad"}


def written(chance, sketch, drivers, names, units, couplings, guess) -> str:
    """Return the TOML of a sketch; numbers as units, bare numbers, expressions or parameters."""
    bent = any("coefficients" in item for item in couplings)
    length, angle = ("m", "rad") if bent else (str(chance.choice([*LENGTHS])), str(chance.choice([*ANGLES])))
    parameters: dict[str, float] = {}

    def number(value: float) -> str:
        bare, pick = value / LENGTHS[length], chance.random()
        if pick < 0.2:
            return f'"{value!r} m"'
        if pick < 0.3:
            return f'"{1e3 * value!r}mm"'
        if pick < 0.5:
            name = f"p{len(parameters)}"
            parameters[name] = float(chance.uniform(0.2, 2) * sketch.size / LENGTHS[length])
            return f'"{bare - parameters[name] / 3!r} + {name}/3"'
        return repr(bare)

    def vector(values: np.ndarray, of=repr) -> str:
        return f"[{', '.join(of(float(item)) for item in values)}]"

    rows = []
    for item in sketch.joints:
        rows.append(f'[joints.{item.name}]\nkind = "{item.kind}"')
        for side, link, (point, axes) in (("a", item.a, item.frame_a), ("b", item.b, item.frame_b)):
            name = f"k{link}" if link else "ground"
            longer = float(chance.choice([1.0, 3.0]))
            place = f"at = {vector(point, number)}, axis = {vector(longer * axes[:, 2])}"
            rows.append(f'{side} = {{ link = "{name}", {place}, reference = {vector(axes[:, 0])} }}')
        if item.kind == "universal" and item.cross != np.pi / 2:
            rows.append(f"cross_angle = {item.cross / ANGLES[angle]!r}")
        if item.kind == "screw":
            rows.append(f"lead = {item.lead / LENGTHS[length]!r}")
    far = sketch.size / LENGTHS[length]
    n = len(sketch.places)
    points = [
        f'{name}{k} = {{ link = "k{k}", at = {vector(far * at)} }}'
        for k in range(1, n)
        for name, at in zip("oxy", PROBES, strict=True)
    ]
    reported = {
        i: "x" for i in range(1, n) if guess == "whole" or (guess == "part" and chance.random() < 0.5)
    }
    guesses = []
    for k in reported:
        place = sketch.places[k] + 3e-3 * sketch.size * chance.normal(size=3)
        matrix = turn(chance.normal(size=3), 3e-3) @ sketch.turns[k]
        rows_of = ", ".join(map(vector, matrix))
        guesses.append(f"k{k} = {{ at = {vector(place / LENGTHS[length])}, rotation = [{rows_of}] }}")
    stands = zip(names, sketch.q, units, strict=True)
    start = [f'"{name}" = "{q!r} {SI[unit]}"' for name, q, unit in stands if name in drivers]
    head = [
        'name = "drawn"',
        f'units = {{ length = "{length}", angle = "{angle}" }}',
        f"drivers = [{', '.join(map(repr, drivers))}]",
        f"start = {{ {', '.join(start)} }}",
        "[parameters]",
        *(f"{name} = {value!r}" for name, value in parameters.items()),
    ]
    tail = ["[points]", *points, *(["[guess]", *guesses] if guesses else [])]
    return "\n".join([*head, *rows, *couplings, *tail]) + "\n"


# points of each link by which its pose is reported, over the size
PROBES = np.array([[0, 0, 0], [1.0, 0, 0], [0, 1.0, 0]])
