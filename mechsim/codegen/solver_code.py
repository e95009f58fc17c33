"""A generated solver: names, constants, records and functions, printed as C99 header or JavaScript module."""

import json
import re
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from mechsim._version import __version__
from mechsim.codegen.assembly import SolvedAssembly
from mechsim.codegen.expressions import comment_text, number_text
from mechsim.codegen.kinematics import (
    INERTIA_NUMBERS,
    JOINT,
    LINK,
    POINT,
    SolverFormulas,
    VaryingNumbers,
    identifiers,
)
from mechsim.errors import InputError
from mechsim.kinetics.initial_state import rotation_quaternions
from mechsim.mechanism.forces import forces_of
from mechsim.mechanism.masses import with_inertia
from mechsim.numerics.arrays import Array

TEMPLATES = Path(__file__).parent / "templates"
# largest step of a driver, in [rad] or characteristic lengths; longer distances are divided into steps
STEP = 0.1
# maximum number of attempted steps of a call
ATTEMPTS = 4096
# iterations of Newton's method after a step
ITERATIONS = 10
# names in the template `solver.c` -> their values
NUMBERS = {
    # smallest pivot of the dimensionless loop Jacobian: closer to a singular configuration, accelerations
    # lose more than 12 of 16 digits
    "PIVOT": 1e-6,
    # Newton's method after a step: largest first correction, in [rad] or characteristic lengths, and largest
    # ratio of successive corrections
    "CORRECTION": 0.02,
    "CONTRACTION": 0.25,
    # failed steps are halved down to this fraction of the first step
    "HALVED": 1.0 / 256.0,
    # largest predicted displacement of an unknown in a step, in [rad] or characteristic lengths: near a
    # singular configuration a prediction that spins a link may end near a solution of another assembly by
    # chance
    "DISPLACEMENT": 0.5,
}
STATUSES = ("SOLVED", "OUT_OF_RANGE", "SINGULAR", "TOO_FAR")
# relative deviation of a spinning link's inertia within which the link is axisymmetric about its line
ROUND = 1e-6


@dataclass(frozen=True)
class SolverCode:
    """Contents of a printed solver.

    Attributes:
        assembly: the solved assembly.
        formulas: formulas for its straight-line code.
        prefix: prefix of all names.
        sizes: name of an integer constant -> value.
        reals: name of an array of numbers -> values, and a comment.
        integers: name of an array of indices -> values, and a comment.
        records: name of a record -> its fields: name, number of values as code, comment.
        functions: code in the common subset of C and JavaScript, `@` for the prefix.
        inertias: inertias of the links, (links, 10); None if torques are undetermined.
        gravity: acceleration of gravity, (3,) in [m/s2].
    """

    assembly: SolvedAssembly
    formulas: SolverFormulas
    prefix: str
    sizes: Mapping[str, int]
    reals: Mapping[str, tuple[Array, str]]
    integers: Mapping[str, tuple[Sequence[int], str]]
    records: Mapping[str, Sequence[tuple[str, str, str]]]
    functions: str
    inertias: Array | None
    gravity: Array

    @property
    def names(self) -> dict[str, tuple[str, Sequence[str]]]:
        """Kind of array entries -> a comment, and the names of the entries by index."""
        return {
            "DRIVER": ("index of each driver", self.assembly.drivers),
            "COORDINATE": ("index of each coordinate of the spanning tree", self.formulas.coordinates),
            "LINK": ("index of each link", self.formulas.links),
            "POINT": ("index of each point", self.formulas.points),
            "JOINT": ("index of each coordinate of a joint that closes a loop", self.formulas.joints),
        }


def solver_code(
    assembly: SolvedAssembly, varying: VaryingNumbers | None = None, geometry: Array | None = None
) -> SolverCode:
    """Return the solver of an assembly.

    Args:
        assembly: the assembly.
        varying: numbers that the code reads from the array GEOMETRY, which a program may change.
        geometry: values of these numbers.

    Raises:
        InputError: if the mechanism has no drivers.
    """
    if not assembly.drivers:
        raise InputError(f"{assembly.mechanism.name}: nothing is driven; name a driver, as by drive=")
    formulas = SolverFormulas(assembly, varying)
    inertias = _inertias(assembly, formulas.links)
    gravity = np.array(forces_of(assembly.source).gravity)
    loops, tree, driven = assembly.loops, assembly.loops.tree, assembly.driven
    unknown, units = loops.unknown, loops.units
    initial = assembly.start.values[:, 0].copy()
    initial[tree.ball_indices] = 0.0
    angles = sorted(i for branch in tree.branches for i in branch.angles)
    balls = [int(np.searchsorted(unknown, ball.first_angle)) for ball in tree.balls]
    quaternions = np.array([rotation_quaternions(rotation)[0] for rotation in assembly.start.turns])
    sizes = {
        "DRIVERS": len(assembly.drivers),
        "COORDINATES": tree.count,
        "UNKNOWNS": len(unknown),
        "UNKNOWNS_OR_1": max(1, len(unknown)),
        "ANGLES": len(angles),
        "BALLS": len(balls),
        "LINKS": len(formulas.links),
        "POINTS": len(formulas.points),
        "JOINTS": len(formulas.joints),
        "SIGN": int(assembly.determinant_sign),
        "ATTEMPTS": ATTEMPTS,
        "ITERATIONS": ITERATIONS,
    }
    integers = {
        # C has no empty arrays
        "UNKNOWN": (unknown.tolist() or [0], "coordinates that the loops determine"),
        "DRIVEN": (driven, "coordinates that are driven"),
        "ANGLE": (angles, "those that are angles"),
        "BALL": (balls, "first of the three rotations of each ball among the unknowns"),
    }
    unit = units[unknown] if len(unknown) else np.ones(1)
    reals = {
        "START": (initial, "coordinates at the start, rad and m"),
        "UNIT": (unit, "one unit of each unknown in the equations"),
        "UNIT_OF_DRIVER": (units[driven], "likewise, of each driver"),
        "STEP": (STEP * units[driven], "largest step of each driver"),
        "START_BALLS": (quaternions.ravel(), "quaternions (w, x, y, z) of the balls at the start"),
        "GRAVITY": (gravity, "of the model, m/s2"),
    }
    if geometry is not None:
        reals["GEOMETRY"] = geometry, "points and axes of joints that follow from dimensions, m"
    if inertias is not None:
        reals["INERTIAS"] = inertias.ravel(), "of the links, as solve_torques takes them; kg, m"
    flags = {
        "ANGLES": bool(angles),
        "BALLS": bool(balls),
        "POINTS": bool(formulas.points),
        "JOINTS": bool(formulas.joints),
        "ONE_DRIVER": len(assembly.drivers) == 1,
        "LIMITED": assembly.interval is not None,
        "TORQUES": inertias is not None,
    }
    return SolverCode(
        assembly,
        formulas,
        identifiers([assembly.mechanism.name])[assembly.mechanism.name],
        sizes,
        {name: entry for name, entry in reals.items() if len(entry[0])},
        {name: entry for name, entry in integers.items() if len(entry[0])},
        _records(flags),
        _functions(formulas, flags),
        inertias,
        gravity,
    )


def _inertias(assembly: SolvedAssembly, links: Sequence[str]) -> Array | None:
    """Return the inertia values of the links; None if a spinning link is not axisymmetric about its line."""
    out: list[Array] = []
    for link in with_inertia(assembly.mechanism).links:
        if link.name not in links:
            continue
        inertia = link.inertia
        assert inertia is not None
        moments, centre = inertia.matrix, np.array(inertia.centre)
        if link.name in assembly.spinning:
            axis = assembly.spinning[link.name]
            across = np.eye(3) - np.outer(axis, axis)
            largest = float(np.abs(moments).max()) or 1.0
            mean = 0.5 * float(np.trace(across @ moments))
            axial = float(axis @ moments @ axis)
            misfit = np.abs(moments - mean * across - axial * np.outer(axis, axis)).max() / largest
            eccentric = np.linalg.norm(across @ centre) / assembly.mechanism.characteristic_length
            if not max(misfit, eccentric) < ROUND:
                return None
            # the spin is zero, so that the axial moment has no effect
            moments = mean * across
        x, y, z = moments
        out.append(np.array([inertia.mass, *centre, x[0], y[1], z[2], x[1], x[2], y[2]]))
    assert all(len(numbers) == INERTIA_NUMBERS for numbers in out)
    return np.array(out)


def _records(flags: Mapping[str, bool]) -> dict[str, list[tuple[str, str, str]]]:
    configuration = [
        ("drivers", "@DRIVERS", "rad or m"),
        ("coordinates", "@COORDINATES", "of the joints of the tree, rad or m"),
    ]
    if flags["BALLS"]:
        configuration.append(("balls", "4 * @BALLS", "quaternions (w, x, y, z), side b seen from side a"))
    state = [
        *configuration,
        ("rates", "@COORDINATES", "per second; of a ball its angular velocity seen from side a"),
        ("accelerations", "@COORDINATES", "per second squared"),
        ("map", "@COORDINATES * @DRIVERS", "derivatives of the coordinates by the drivers: motor-joint map"),
        ("cosines", "@COORDINATES", "of the coordinates that are angles"),
        ("sines", "@COORDINATES", ""),
        ("lu", "@UNKNOWNS_OR_1 * @UNKNOWNS_OR_1", "factors of the loop Jacobian"),
        ("inverses", "@UNKNOWNS_OR_1", "of its pivots"),
        ("second", "@UNKNOWNS_OR_1", "second derivative by a single driver, negative and free of units"),
    ]
    return {
        "configuration": configuration,
        "state": state,
        "point": [(name, str(count), "") for name, count in POINT.items()],
        "joint": [(name, str(count), "value, rate, acceleration") for name, count in JOINT.items()],
        "link": [(name, str(count), "") for name, count in LINK.items()],
    }


def _functions(formulas: SolverFormulas, flags: Mapping[str, bool]) -> str:
    code = {
        "EQUATIONS": formulas.equations(),
        "VELOCITY_PRODUCTS": formulas.velocity_products(),
        "LINK_MOTIONS": formulas.link_motions(),
        "POINT_MOTIONS": formulas.point_motions() if flags["POINTS"] else [],
        "JOINT_MOTIONS": formulas.joint_motions() if flags["JOINTS"] else [],
        "FORCES": formulas.torques() if flags["TORQUES"] else [],
    }
    text = template("solver.c", flags)
    for name, lines in code.items():
        if name != "VELOCITY_PRODUCTS":
            lines = [line.replace(" = rates[", " = s->rates[") for line in lines]
        text = text.replace(f"  {name}\n", "".join(f"  {line}\n" for line in lines))
    limits = formulas.assembly.interval
    ends = {} if limits is None else {"LOW": float(limits[0]), "HIGH": float(limits[1])}
    for name, value in (NUMBERS | ends).items():
        text = text.replace(f"@{name}", number_text(value))
    return text


def template(name: str, flags: Mapping[str, bool]) -> str:
    """Return a file of `templates`, of its sections `#if FLAG` or `#if !FLAG` only those that apply.

    `@` is a placeholder for the prefix of all names. The templates are in C, `solver.c` in the common subset
    of C and JavaScript that `printing` translates; `test.js` is in JavaScript.
    """
    text = (TEMPLATES / name).read_text(encoding="utf-8").strip()
    lines: list[str] = []
    active = [True]
    for line in text.splitlines():
        condition = re.fullmatch(r"#if (!?)(\w+)", line)
        if condition:
            active.append(active[-1] and flags[condition[2]] != bool(condition[1]))
        elif line == "#endif":
            active.pop()
        elif active[-1]:
            lines.append(line)
    return "\n".join(lines)


# numbers per line in a constant array
PER_LINE = 5
C_HEAD = """
#include <float.h>
#include <tgmath.h>

/* the type of all numbers: double, or as -DMECHSIM_REAL=float has it */
#ifndef MECHSIM_REAL
#define MECHSIM_REAL double
#endif
#ifndef MECHSIM_C
#define MECHSIM_C(number) ((MECHSIM_REAL)(number))
#endif

typedef MECHSIM_REAL @real;
""".strip()
# common subset of C and JavaScript -> JavaScript
TRANSLATION: Sequence[tuple[str, str]] = (
    (r"^ *\(void\).*\n", ""),
    (r"static inline \w+ ([\w@]+)\(([^)]*)\)", r"function \1(\2)"),
    (r"(?<=[(,])( ?)(?:const )?(?:@?\w+) \*(\w+)(?=[,)])", r"\1\2"),
    (r"(?:const )?(?:real|@state|@configuration) (\w+)\[([^\]]+)\];", r"const \1 = new Float64Array(\2);"),
    (r"(@configuration) (\w+);", r"const \2 = \1();"),
    (r"const (?:real|int) ", "const "),
    (r"\b(?:real|int) (?=\w+ =)", "let "),
    (r"->", "."),
    (r"(?<=, )&(?=\w)", ""),
    (r"\bR\(", "("),
    (r"\((-?[\d.e-]+)\)", r"\1"),
    (r"\bfabs\(", "Math.abs("),
    (r"\b(sqrt|cos|sin|atan2)\(", r"Math.\1("),
    (r"@EPSILON", "Number.EPSILON"),
)


def c_header(code: SolverCode) -> str:
    """Return the solver as one C99 header."""
    prefix = code.prefix
    lines = [f"#ifndef MECHSIM_{prefix}_H", f"#define MECHSIM_{prefix}_H", *_comment(code), C_HEAD, ""]
    lines.append(
        "#define @EPSILON ((@real)(sizeof(@real) < sizeof(double) ? (double)FLT_EPSILON : DBL_EPSILON))"
    )
    lines += _enumeration("numbers and limits", code.sizes)
    lines += _enumeration("statuses", {status: i for i, status in enumerate(STATUSES)})
    for kind, (comment, names) in code.names.items():
        plain = identifiers(names).values()
        lines += _enumeration(comment, {f"{kind}_{name}": i for i, name in enumerate(plain)})
    for name, (values, comment) in code.integers.items():
        lines += [f"/* {comment} */", *c_array("int", f"@{name}", [str(value) for value in values])]
    for name, (numbers, comment) in code.reals.items():
        width = INERTIA_NUMBERS if name == "INERTIAS" else PER_LINE
        entries = [repr(value) for value in numbers.tolist()]
        lines += [f"/* {comment} */", *c_array("@real", f"@{name}", entries, width)]
    for name, record in code.records.items():
        lines += ["", "typedef struct {"]
        for field, count, comment in record:
            lines.append(f"  @real {field}[{count}];" + (f" /* {comment} */" if comment else ""))
        lines += [*(["  int pivots[@UNKNOWNS_OR_1];"] if name == "state" else []), f"}} @{name};"]
    functions = re.sub(r"\breal\b", "@real", re.sub(r"\bR\(", "MECHSIM_C(", code.functions))
    text = "\n".join([*lines, "", functions, "", "#endif", ""])
    return text.replace("@", f"{prefix}_")


def javascript(code: SolverCode) -> str:
    """Return the solver as a JavaScript file: a module in Node.js, or a global name in a browser."""
    prefix = code.prefix
    lines = [*_comment(code), f"const {prefix}_solver = (() => {{", '"use strict";']
    lines += [f"const @{name} = {value};" for name, value in code.sizes.items()]
    lines += [f"const @{name} = {i};" for i, name in enumerate(STATUSES)]
    for name, (values, comment) in code.integers.items():
        lines.append(f"const @{name} = {json.dumps([*values])}; /* {comment} */")
    for name, (numbers, comment) in code.reals.items():
        lines.append(f"const @{name} = {json.dumps(numbers.tolist())}; /* {comment} */")
    for name, record in code.records.items():
        fields = [f"{field}: new Float64Array({count})" for field, count, _ in record]
        fields += ["pivots: new Int32Array(@UNKNOWNS_OR_1)"] if name == "state" else []
        lines.append(f"const @{name} = () => ({{ {', '.join(fields)} }});")
    functions = code.functions
    for pattern, replacement in TRANSLATION:
        functions = re.sub(pattern, replacement, functions, flags=re.MULTILINE)
    arrays = [f"{kind.lower()}s: {json.dumps([*names])}" for kind, (_, names) in code.names.items()]
    exported = ["state", "configuration", "start", "save", "restore", "solve", "point", "link", "solve_links"]
    exported += ["joint", "solve_joints"] if code.sizes["JOINTS"] else []
    exported += ["solve_points"] if code.sizes["POINTS"] else []
    exported += ["solve_torques"] if code.inertias is not None else []
    entries = [f"{name}: @{name}" for name in exported]
    entries += [f"{name}: @{name}" for name in STATUSES]
    entries += ["GEOMETRY: @GEOMETRY"] if "GEOMETRY" in code.reals else []
    entries += ["GRAVITY: @GRAVITY"] + (["INERTIAS: @INERTIAS"] if code.inertias is not None else [])
    lines += [functions, f"return {{ {', '.join([*arrays, *entries])} }};", "})();"]
    lines.append(f'if (typeof module !== "undefined") {{ module.exports = {prefix}_solver; }}')
    return "\n".join([*lines, ""]).replace("@", "")


def _comment(code: SolverCode) -> Iterator[str]:
    """Yield the lines of the header comment."""
    assembly = code.assembly
    limits = assembly.interval
    range_text = "any value" if limits is None else f"{limits[0]:.9g} to {limits[1]:.9g} rad"
    spinning = ", ".join(sorted(assembly.spinning))
    yield f"/* Solver of {comment_text(assembly.mechanism.name)}, generated by mechsim {__version__}."
    yield f"   Drivers: {comment_text(', '.join(assembly.drivers))}; range: {range_text}."
    yield "   SI units. Call start() once, then solve() at each configuration: it follows the assembly from"
    yield "   the last one in steps. Where it cannot it stays there and returns a status other than SOLVED."
    if spinning:
        yield f"   Nothing determines the spin of {comment_text(spinning)} about its line: it has no meaning."
    if code.inertias is None:
        yield "   Torques are left out: the inertia of a link that spins is not round about its line."
    yield "*/"


def _enumeration(comment: str, values: Mapping[str, int]) -> list[str]:
    entries = [f"  @{name} = {value}," for name, value in values.items()]
    return ["", f"/* {comment} */", "enum {", *entries, "};"] if entries else []


def c_array(kind: str, name: str, entries: Sequence[str], width: int = PER_LINE) -> Iterator[str]:
    """Yield the lines of a constant array in C, with `width` entries each."""
    yield f"static const {kind} {name}[{len(entries)}] = {{"
    for i in range(0, len(entries), width):
        yield f"  {', '.join(entries[i : i + width])},"
    yield "};"
