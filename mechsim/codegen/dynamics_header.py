"""A dynamic model as one C99 header without allocation, and its test against mechsim's own run."""

import ctypes
from collections.abc import Mapping
from string import Template

import numpy as np

from mechsim._version import __version__
from mechsim.codegen.fmu import FmuModel
from mechsim.codegen.solver_code import TEMPLATES
from mechsim.errors import InputError
from mechsim.kinetics.dynamic_run import TOLERANCE, Initial, run
from mechsim.kinetics.model import DynamicModel
from mechsim.numerics.c_library import loaded_library

# memory in bytes in which a first step shows how much the functions use: 50 kB for Jansen's leg
LARGEST_MEMORY = 1 << 28
# number of numbers that the integrator keeps between two calls: `Snapshot` of fmu_dynamics.c
KEPT = 10
# length of the first step in [s]
FIRST_STEP = 1e-6
# number of instants of a test; its tolerance relative to the largest value of a quantity, as that of FMUs;
# the least such value in SI
INSTANTS, AGREED, LEAST = 10, 1e-9, 1e-3
# factor on the tolerance of a second run, whose difference shows how sensitive each quantity is
COARSER = 30.0


def dynamics_header(model: FmuModel) -> str:
    """Return a model of `dynamic_fmu` as a C header whose memory is as large as its first step needs.

    Raises:
        MissingToolError: if there is no C compiler, which the measurement needs.
        InputError: if no step is possible at the start.
    """
    name, values = model.identifier, len(model.variables)
    text = _header(model, LARGEST_MEMORY)
    tried = loaded_library(f"dynamics_{name}", f"#define {name}_IMPLEMENTATION\n{text}")
    calls = {what: getattr(tried, f"{name}_{what}") for what in ("start", "begin", "advance", "memory")}
    calls["begin"].restype = calls["advance"].restype = ctypes.c_char_p
    calls["memory"].restype = ctypes.c_size_t
    motion = (ctypes.c_double * (KEPT + values))()
    calls["start"](motion)
    error = calls["begin"](motion) or calls["advance"](motion, ctypes.c_double(FIRST_STEP))
    if error:
        raise InputError(f"{model.name}: {error.decode()}; give another initial state")
    return _header(model, int(calls["memory"]()))


def _header(model: FmuModel, memory: int) -> str:
    prefix = model.identifier
    names = (f'"{v.name}{f" [{v.unit}]" if v.unit else ""}"' for v in model.variables)
    return _filled(
        "dynamics.h",
        prefix,
        name=model.name,
        version=__version__,
        kept=KEPT,
        memory=memory,
        numbers="".join(f"    {prefix}_{kind} = {number},\n" for kind, number in model.first.items()),
        plain="".join(f"    {kind} = {number},\n" for kind, number in model.first.items()),
        starts=", ".join(repr(variable.start or 0.0) for variable in model.variables),
        names=",\n    ".join(names),
        code=model.code,
    )


def dynamics_test(model: FmuModel, source: DynamicModel, initial: Mapping[str, Initial], header: str) -> str:
    """Return a C program that compares a header with mechsim's own run of the same duration.

    Raises:
        InputError: if that run ends early.
    """
    coarse, exact = (
        run(source, initial=initial, duration=model.duration, samples=INSTANTS, tolerance=tolerance)
        for tolerance in (COARSER * TOLERANCE, TOLERANCE)
    )
    if {coarse.outcome, exact.outcome} != {"done"}:
        raise InputError(
            f"{model.name}: a test of the header needs a run of {model.duration:g} s, and mechsim's own ends "
            f"with {exact.outcome!r}; leave out --test, or give another initial state"
        )
    # the largest value is often that of the start, as of accelerations that friction reduces at once
    other, columns = (dict(each.columns()) for each in (coarse, exact))
    names = {i: v.name for i, v in enumerate(model.variables) if i and v.name in columns}
    allowed = [
        float(AGREED * max(np.abs(columns[name]).max(), LEAST) + np.abs(columns[name] - other[name]).max())
        for name in names.values()
    ]
    table = np.stack([columns[name][1:] for name in names.values()], 1)
    arrays = (
        ("int", "compared", [*names]),
        ("double", "times", exact.time[1:].tolist()),
        ("double", "allowed", allowed),
        ("double", "expected", table.ravel().tolist()),
    )
    data = [f"enum {{ INSTANTS = {len(table)}, COMPARED = {len(names)} }};"]
    data += [f"static const {kind} {name}[] = {{{', '.join(map(repr, row))}}};" for kind, name, row in arrays]
    return _filled("dynamics_test.c", model.identifier, name=model.name, header=header, data="\n".join(data))


def _filled(template: str, prefix: str, **words: object) -> str:
    """Return a file of `templates` with its words, and the prefix of all names in place of @."""
    text = (TEMPLATES / template).read_text(encoding="utf-8").replace("@", f"{prefix}_")
    return Template(text).substitute(words)
