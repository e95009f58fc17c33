"""Random mechanisms as TOML, each generated around an assembled pose, for `random_toml_mechanisms.py`.

Links have random poses. Chains of joints with random coordinates connect them and close loops: spatial,
planar in a tilted plane, or spherical. Gears, racks and polynomials couple coordinates at their values.
Drivers are chosen so that only passive rotations stay undetermined, by the rank of equations that are
independent of mechsim.
"""

from dataclasses import dataclass

import numpy as np
from maximal_coordinates import DOFS, UNITS, ZERO_SINGULAR_VALUE, ConstraintModel, Joint, MotionLaw

DRIVABLE = ("revolute", "prismatic", "cylindrical")
LENGTHS = {"m": 1.0, "mm": 1e-3, "cm": 1e-2, "inch": 0.0254}
ANGLES = {"rad": 1.0, "deg": np.pi / 180}
SPATIAL = [*DOFS][1:]


@dataclass
class RandomMechanism:
    """A mechanism as TOML, its reference model and pose, and its drivers."""

    text: str
    model: ConstraintModel
    pose: np.ndarray
    names: list[str]  # of all coordinates
    units: list[str]  # of these: r or m
    columns: list[str]  # their columns in a table, with * for q, v or a
    drivers: list[int]
    amplitudes: list[float]
    guess: str
    label: str


def rotation_matrix(axis: np.ndarray, angle: float) -> np.ndarray:
    """Return the rotation matrix about an axis by an angle in [rad]."""
    x, y, z = axis / np.linalg.norm(axis)
    cross = np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])
    return np.eye(3) + np.sin(angle) * cross + (1 - np.cos(angle)) * cross @ cross


def quaternion_of(matrix: np.ndarray) -> np.ndarray:
    """Return the quaternion (w, x, y, z) of a rotation matrix."""
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


def relative_pose(joint: Joint, q: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return position and rotation of b's frame in a's at given coordinates."""
    x, y, z = np.eye(3)
    if joint.kind == "universal":
        # at zero, b's axis is tilted from a's axis towards a's reference, and b's reference towards a's axis
        tilt = rotation_matrix(y, joint.cross) @ rotation_matrix(z, np.pi)
        return 0 * z, rotation_matrix(z, q[0]) @ tilt @ rotation_matrix(z, q[1])
    shift = {"planar": lambda: q[0] * x + q[1] * y}.get(joint.kind, lambda: q[0] * z)
    slides = UNITS[joint.kind].startswith("m")
    return shift() if slides else 0 * z, rotation_matrix(z, q[-1]) if UNITS[joint.kind].endswith(
        "r"
    ) else np.eye(3)


class Sketch:
    """Links at random poses, and chains of joints between them."""

    def __init__(self, chance: np.random.Generator) -> None:
        self.chance = chance
        self.mode = str(chance.choice(["spatial", "planar", "spherical"], p=[0.5, 0.35, 0.15]))
        self.length = float(10 ** chance.uniform(-2, 0))
        self.frame = self.random_rotation()
        self.positions, self.rotations = [np.zeros(3)], [np.eye(3)]
        self.joints: list[Joint] = []
        self.q: list[float] = []

    def random_rotation(self) -> np.ndarray:
        result = np.linalg.qr(self.chance.normal(size=(3, 3)))[0]
        return result * np.linalg.det(result)

    def chain_kinds(self, dofs: int) -> list[str]:
        """Return random joint kinds with this total number of degrees of freedom."""
        result: list[str] = []
        while dofs:
            if self.mode == "spatial":
                allowed = [kind for kind in SPATIAL if DOFS[kind] <= dofs]
            elif self.mode == "planar":
                allowed = ["revolute", "revolute", "revolute", "prismatic"]
            else:
                allowed = ["revolute", "revolute", "universal"][: 2 if dofs == 1 else 3]
            result.append(str(self.chance.choice(allowed)))
            dofs -= DOFS[result[-1]]
        looser = {"planar": ["cylindrical", "spherical"], "spherical": ["spherical"]}.get(self.mode)
        for i, kind in enumerate(result):
            if looser and kind == "revolute" and self.chance.random() < 0.12:
                result[i] = str(self.chance.choice(looser))
        if self.chance.random() < 0.1:
            result.insert(int(self.chance.integers(len(result) + 1)), "fixed")
        return [str(item) for item in self.chance.permutation(result)]

    def add_chain(self, kinds: list[str], first: int, last: int) -> None:
        """Connect two links by a chain of joints and new links."""
        link = first
        for i, kind in enumerate(kinds):
            if i < len(kinds) - 1:
                self.positions.append(self.length * self.chance.uniform(-1, 1, 3))
                self.rotations.append(self.random_rotation())
                next_link = len(self.positions) - 1
            else:
                next_link = last
            self.add_joint(kind, *((link, next_link) if self.chance.random() < 0.7 else (next_link, link)))
            link = next_link

    def add_joint(self, kind: str, a: int, b: int) -> None:
        """Add a joint between two links at their poses."""
        chance = self.chance
        point = self.length * chance.uniform(-1, 1, 3) * (self.mode != "spherical")
        axes = self.random_rotation()
        if self.mode == "planar":
            in_plane = rotation_matrix(np.array([0, 0, 1.0]), chance.uniform(-3, 3))
            axes = self.frame @ in_plane @ (np.eye(3)[[2, 0, 1]] if kind == "prismatic" else np.eye(3))
        new = Joint(f"j{len(self.joints)}", kind, a, b, (point, axes), (point, axes), index=len(self.q))
        q = [float(chance.uniform(-0.4, 0.4) * (self.length if u == "m" else 6.0)) for u in UNITS[kind]]
        if kind == "universal" and chance.random() < 0.3:
            new.cross = float(chance.uniform(0.6, 2.5))
        if kind == "screw":
            new.lead = float(chance.uniform(0.2, 1.0) * self.length)
            q[0] = new.lead * q[1] / (2 * np.pi)
        shift, rel = (
            relative_pose(new, np.array(q)) if kind != "spherical" else (np.zeros(3), self.random_rotation())
        )
        new.frame_a = self.in_link(a, point, axes)
        new.frame_b = self.in_link(b, point + axes @ shift, axes @ rel)
        self.joints.append(new)
        self.q += q

    def in_link(self, link: int, point: np.ndarray, axes: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        inverse = self.rotations[link].T
        return inverse @ (point - self.positions[link]), inverse @ axes


def random_mechanism(seed: int) -> RandomMechanism | None:
    """Return a mechanism, or None if no drivers determine it."""
    chance = np.random.default_rng(seed)
    sketch = Sketch(chance)
    loop_constraints = 6 if sketch.mode == "spatial" else 3
    mobility = int(chance.choice([1, 2, 3], p=[0.55, 0.3, 0.15]))
    sketch.add_chain(sketch.chain_kinds(loop_constraints + mobility), 0, 0)
    for _ in range(int(chance.choice([0, 1, 2], p=[0.5, 0.35, 0.15]))):
        first, last = chance.choice(len(sketch.positions), 2, replace=False)
        sketch.add_chain(
            sketch.chain_kinds(loop_constraints + int(chance.choice([0, 0, 1]))), int(first), int(last)
        )
    n = len(sketch.positions) - 1
    model = ConstraintModel(n, sketch.length, sketch.joints)
    positions = np.ravel(sketch.positions[1:]) / sketch.length
    pose = np.concatenate([positions, *map(quaternion_of, sketch.rotations[1:]), sketch.q])
    names, columns, units, drivable = [], [], [], []
    for item in sketch.joints:
        kind = UNITS[item.kind]
        suffixes = {1: [""], 2: [".way", ".turn"], 3: [".x", ".y", ".turn"]}.get(len(kind), [])
        suffixes = [".1", ".2"] if item.kind == "universal" else suffixes
        names += [item.name + end for end in suffixes]
        columns += [f"{item.name}.*{i if len(kind) > 1 else ''}" for i in range(len(kind))]
        units += kind
        drivable += [item.kind in DRIVABLE] * len(kind)
    if np.abs(model.residual(pose, 0.0)).max() > 1e-12:
        raise AssertionError(f"seed {seed}: the mechanism is not assembled")
    motions = null_space(model, pose)[:, 7 * n :]
    couplings: list[str] = []
    while np.linalg.matrix_rank(motions, 1e-6) > 1 and chance.random() < 0.35:
        coupling = random_coupling(chance, names, units, sketch, len(couplings))
        model.couplings.append(coupling[1])
        motions = null_space(model, pose)[:, 7 * n :]
        couplings.append(coupling[0])
    drivers: list[int] = []
    for i in chance.permutation(np.flatnonzero(drivable)):
        if np.linalg.norm(motions[:, i]) > 0.05 and len(motions):
            drivers.append(int(i))
            direction = motions[:, i : i + 1] / np.linalg.norm(motions[:, i])
            motions = motions - direction @ (direction.T @ motions)
    if not drivers or len(drivers) > 3 or np.abs(motions).max(initial=0.0) > 1e-8:
        return None
    for i in drivers:
        model.laws[i] = constant(sketch.q[i])
    guess = str(chance.choice(["complete", "partial", "none"], p=[0.5, 0.25, 0.25]))
    text = to_toml(chance, sketch, [names[i] for i in drivers], names, units, couplings, guess)
    amplitudes = [1.0 if units[i] == "r" else 0.4 * sketch.length for i in drivers]
    kinds = "".join(KIND_LETTERS[item.kind] for item in sketch.joints)
    label = f"{sketch.mode} {kinds}{f' {len(couplings)} coupled' if couplings else ''} of {len(drivers)}"
    return RandomMechanism(text, model, pose, names, units, columns, drivers, amplitudes, guess, label)


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


def constant(value: float) -> MotionLaw:
    return lambda t: value


def null_space(model: ConstraintModel, pose: np.ndarray) -> np.ndarray:
    """Return a basis of the null space of the Jacobian, (k, unknowns)."""
    values, right = np.linalg.svd(model.jacobian(pose, 0.0))[1:]
    return right[int((values > ZERO_SINGULAR_VALUE * values[0]).sum()) :]


def random_coupling(chance, names, units, sketch, count):
    """Return a coupling of two coordinates, or of a sum of two and a third, as text and as an equation."""
    chosen = [int(i) for i in chance.permutation(len(names))[:3]]
    q = [sketch.q[i] for i in chosen]
    first, second, third = chosen
    head = f'[couplings.c{count}]\ndriver = "{names[first]}"\n'
    unit_pair = units[first] + units[second]
    if unit_pair in ("rm", "mr") and chance.random() < 0.6:
        radius = float(chance.uniform(0.2, 0.6) * sketch.length * chance.choice([-1, 1]))
        gradient = radius if unit_pair == "rm" else 1 / radius
        phase = q[1] - gradient * q[0]
        text = (
            f'driven = "{names[second]}"\nradius = "{radius!r} m"\nphase = "{phase!r} {SI[units[second]]}"\n'
        )
        return head + text, lambda x: x[..., second] - gradient * x[..., first] - phase
    if unit_pair == "rr" and chance.random() < 0.6:
        ratio = float(chance.uniform(0.4, 2.0) * chance.choice([-1, 1]))
        phase = q[1] - ratio * q[0]
        text = f'driven = "{names[second]}"\nratio = {ratio!r}\nphase = "{phase!r} rad"\n'
        return head + text, lambda x: x[..., second] - ratio * x[..., first] - phase
    scale = [sketch.length if units[i] == "m" else 1.0 for i in chosen]
    factors = chance.uniform(-0.6, 0.6, int(chance.integers(1, 4)))
    powers = [float(c * scale[1] / scale[0] ** (i + 1)) for i, c in enumerate(factors)]
    polynomial = sum(c * q[0] ** (i + 1) for i, c in enumerate(powers))
    extra = units[third] == units[second] and len(names) > 2
    constant = q[1] + 0.7 * extra * q[2] - polynomial
    # the constant has the unit of its coordinate; derivatives have the units of the file, here SI
    coefficients = ", ".join(repr(c) for c in [constant, *powers])
    driven = f'{{ "{names[second]}" = 1, "{names[third]}" = 0.7 }}' if extra else f'"{names[second]}"'
    text = f"driven = {driven}\ncoefficients = [{coefficients}]\n"

    def law(x: np.ndarray) -> np.ndarray:
        right = sum(c * x[..., first] ** (i + 1) for i, c in enumerate(powers))
        return x[..., second] + 0.7 * extra * x[..., third] - constant - right

    return head + text, law


SI = {"m": "m", "r": "rad"}


def to_toml(chance, sketch, drivers, names, units, couplings, guess) -> str:
    """Return the TOML of a sketch; numbers with units, without, as expressions or parameters."""
    polynomial = any("coefficients" in item for item in couplings)
    length, angle = (
        ("m", "rad") if polynomial else (str(chance.choice([*LENGTHS])), str(chance.choice([*ANGLES])))
    )
    parameters: dict[str, float] = {}

    def number(value: float) -> str:
        plain, choice = value / LENGTHS[length], chance.random()
        if choice < 0.2:
            return f'"{value!r} m"'
        if choice < 0.3:
            return f'"{1e3 * value!r}mm"'
        if choice < 0.5:
            name = f"p{len(parameters)}"
            parameters[name] = float(chance.uniform(0.2, 2) * sketch.length / LENGTHS[length])
            return f'"{plain - parameters[name] / 3!r} + {name}/3"'
        return repr(plain)

    def vector(values: np.ndarray, text_of=repr) -> str:
        return f"[{', '.join(text_of(float(item)) for item in values)}]"

    rows = []
    for item in sketch.joints:
        rows.append(f'[joints.{item.name}]\nkind = "{item.kind}"')
        for side, link, (point, axes) in (("a", item.a, item.frame_a), ("b", item.b, item.frame_b)):
            name = f"k{link}" if link else "ground"
            longer = float(chance.choice([1.0, 3.0]))
            position = f"at = {vector(point, number)}, axis = {vector(longer * axes[:, 2])}"
            rows.append(f'{side} = {{ link = "{name}", {position}, reference = {vector(axes[:, 0])} }}')
        if item.kind == "universal" and item.cross != np.pi / 2:
            rows.append(f"cross_angle = {item.cross / ANGLES[angle]!r}")
        if item.kind == "screw":
            rows.append(f"lead = {item.lead / LENGTHS[length]!r}")
    length_in_units = sketch.length / LENGTHS[length]
    n = len(sketch.positions)
    points = [
        f'{name}{k} = {{ link = "k{k}", at = {vector(length_in_units * probe)} }}'
        for k in range(1, n)
        for name, probe in zip("oxy", PROBES, strict=True)
    ]
    guessed = {
        i: "x" for i in range(1, n) if guess == "complete" or (guess == "partial" and chance.random() < 0.5)
    }
    guesses = []
    for k in guessed:
        position = sketch.positions[k] + 3e-3 * sketch.length * chance.normal(size=3)
        matrix = rotation_matrix(chance.normal(size=3), 3e-3) @ sketch.rotations[k]
        matrix_rows = ", ".join(map(vector, matrix))
        guesses.append(f"k{k} = {{ at = {vector(position / LENGTHS[length])}, rotation = [{matrix_rows}] }}")
    coordinates = zip(names, sketch.q, units, strict=True)
    start = [f'"{name}" = "{q!r} {SI[unit]}"' for name, q, unit in coordinates if name in drivers]
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


# points of each link that report its pose, relative to the size
PROBES = np.array([[0, 0, 0], [1.0, 0, 0], [0, 1.0, 0]])
