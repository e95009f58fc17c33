"""A solver as a C99 header or a JavaScript module."""

import json
import re
from collections.abc import Iterator, Mapping, Sequence

from mechsim._version import __version__
from mechsim.codegen.expressions import comment_text
from mechsim.codegen.kinematics import INERTIA_NUMBERS, identifiers
from mechsim.codegen.solver_code import STATUSES, SolverCode

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
