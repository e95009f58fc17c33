"""A model as an FMU (Functional Mock-up Unit): variables, description, sources and binary in one archive.

Source: Functional Mock-up Interface Specification 3.0.2 and 2.0.5, Modelica Association.
"""

import hashlib
import io
import platform
import zipfile
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from itertools import accumulate
from typing import Literal
from xml.etree import ElementTree

from mechsim._version import __version__
from mechsim.codegen.kinematics import identifiers
from mechsim.codegen.solver_code import TEMPLATES
from mechsim.errors import InputError
from mechsim.numerics.c_library import shared_library

Standard = Literal[2, 3]
# unit -> its exponents of SI units
UNITS = {
    "rad": {"rad": 1},
    "rad/s": {"rad": 1, "s": -1},
    "rad/s2": {"rad": 1, "s": -2},
    "m": {"m": 1},
    "m/s": {"m": 1, "s": -1},
    "m/s2": {"m": 1, "s": -2},
    "1/s": {"s": -1},
    "N": {"kg": 1, "m": 1, "s": -2},
    "N/m": {"kg": 1, "s": -2},
    "N.s/m": {"kg": 1, "s": -1},
    "N.m": {"kg": 1, "m": 2, "s": -2},
    "N.m/rad": {"kg": 1, "m": 2, "s": -2, "rad": -1},
    "N.m.s/rad": {"kg": 1, "m": 2, "s": -1, "rad": -1},
    "J": {"kg": 1, "m": 2, "s": -2},
    "kg": {"kg": 1},
    "kg.m2": {"kg": 1, "m": 2},
    "s": {"s": 1},
}
# time of all entries of an archive, the earliest that the format holds: equal models give equal archives
EPOCH = (1980, 1, 1, 0, 0, 0)
# processor, as Python names it -> its name in FMI 3.0
PROCESSORS = {"x86_64": "x86_64", "amd64": "x86_64", "aarch64": "aarch64", "arm64": "aarch64"}
# kind of values in C -> their causality, variability and initial in FMI
KINDS = {
    "INDEPENDENT": "independent continuous",
    "INPUT": "input continuous",
    "PARAMETER": "parameter fixed exact",
    "STATE": "output continuous exact",
    "DERIVATIVE": "output continuous calculated",
    "OUTPUT": "output continuous calculated",
}


@dataclass(frozen=True, slots=True)
class Variable:
    """A variable of an FMU.

    Attributes:
        name: its name.
        unit: one of `UNITS`; empty for a number without a unit.
        start: value at the start; None for one that follows from others.
        description: what it is.
    """

    name: str
    unit: str
    start: float | None = None
    description: str = ""


@dataclass(frozen=True)
class FmuModel:
    """A model as an FMU; in C its values are numbered in the order of these attributes, after the time.

    Attributes:
        name: name of the mechanism.
        inputs: its inputs.
        parameters: numbers that are constant after the initialization.
        states: its continuous states.
        derivatives: their derivatives by time.
        outputs: its other outputs.
        code: the model in C without numbers of values, as the template `fmu.c` uses it.
        duration: duration of a run in [s].
    """

    name: str
    inputs: Sequence[Variable]
    parameters: Sequence[Variable]
    states: Sequence[Variable]
    derivatives: Sequence[Variable]
    outputs: Sequence[Variable]
    code: str
    duration: float

    def __post_init__(self) -> None:
        names = [variable.name for variable in self.variables]
        for name in names:
            if names.count(name) > 1:
                raise InputError(
                    f"{self.name}: two variables of the FMU are named {name!r}; rename one of them"
                )

    @cached_property
    def kinds(self) -> dict[str, Sequence[Variable]]:
        """The variables of each of `KINDS`."""
        variables = self.inputs, self.parameters, self.states, self.derivatives, self.outputs
        return dict(zip(KINDS, ((Variable("time", "s"),), *variables), strict=True))

    @cached_property
    def variables(self) -> list[Variable]:
        """All variables, by number."""
        return [variable for variables in self.kinds.values() for variable in variables]

    @property
    def identifier(self) -> str:
        """Name of the binary."""
        return identifiers([self.name])[self.name]

    @cached_property
    def first(self) -> dict[str, int]:
        """Name of a kind of values in C -> number of the first of them; numbers of states and of values."""
        sizes = [len(variables) for variables in self.kinds.values()]
        firsts = dict(zip((*KINDS, "VALUES"), accumulate(sizes, initial=0), strict=True))
        return firsts | {"STATES": len(self.states)}

    @cached_property
    def token(self) -> str:
        """What identifies the variables and the code."""
        digest = hashlib.sha256(repr((self.variables, self.code, __version__)).encode()).hexdigest()
        return "-".join(digest[i:j] for i, j in ((0, 8), (8, 12), (12, 16), (16, 20), (20, 32)))

    def source(self, standard: Standard) -> str:
        """Return the C code of the FMU."""
        numbers = "".join(f"    {name} = {value},\n" for name, value in self.first.items())
        starts = ", ".join(repr(variable.start or 0.0) for variable in self.variables)
        return "\n".join(
            [
                f"/* FMU of {self.identifier}, generated by mechsim {__version__}. */",
                "#include <math.h>\n#include <stddef.h>\n#include <stdlib.h>\n#include <string.h>",
                _text(f"fmi{standard}_types.c"),
                '#define EXPORTED __attribute__((visibility("default")))',
                "#pragma GCC visibility push(hidden)",
                f"\n/* numbers of the first values of each kind */\nenum {{\n{numbers}}};",
                f"static const double START[VALUES] = {{{starts}}};",
                f'static const char TOKEN[] = "{self.token}";\n',
                self.code,
                _text("fmu.c"),
                _text("fmi.c"),
                _text(f"fmi{standard}.c"),
                "",
            ]
        )


def _text(name: str) -> str:
    return (TEMPLATES / name).read_text(encoding="utf-8")


def fmu_archive(model: FmuModel, standard: Standard) -> bytes:
    """Return an FMU with its sources and a binary for this machine.

    Raises:
        MissingToolError: if there is no C compiler, or it fails.
        InputError: if FMI has no name for this machine.
    """
    source = model.source(standard)
    folder, suffix = _platform(standard)
    library = shared_library(f"fmu_{model.identifier}", source).read_bytes()
    contents = {
        "modelDescription.xml": _description(model, standard).encode(),
        f"binaries/{folder}/{model.identifier}.{suffix}": library,
        "sources/fmu.c": source.encode(),
    }
    if standard == 3:
        contents["sources/buildDescription.xml"] = _build_description(model).encode()
    written = io.BytesIO()
    with zipfile.ZipFile(written, "w") as archive:
        for name, content in contents.items():
            entry = zipfile.ZipInfo(name, EPOCH)
            entry.compress_type = zipfile.ZIP_DEFLATED
            entry.external_attr = 0o644 << 16
            archive.writestr(entry, content)
    return written.getvalue()


def _platform(standard: Standard) -> tuple[str, str]:
    """Return the folder of binaries and their suffix on this machine."""
    processor = PROCESSORS.get(platform.machine().lower())
    system = "darwin" if platform.system() == "Darwin" else "linux"
    suffix = "dylib" if system == "darwin" else "so"
    if standard == 3 and processor is not None:
        return f"{processor}-{system}", suffix
    if standard == 2 and (processor == "x86_64" or system == "darwin"):
        return f"{system}64", suffix
    raise InputError(
        f"FMI {standard}.0 has no name for binaries of the processor {platform.machine()}; "
        "write the solver as C by -o solver.h"
    )


def _build_description(model: FmuModel) -> str:
    root = ElementTree.Element("fmiBuildDescription", fmiVersion="3.0")
    build = ElementTree.SubElement(root, "BuildConfiguration", modelIdentifier=model.identifier)
    files = ElementTree.SubElement(build, "SourceFileSet", language="C99")
    ElementTree.SubElement(files, "SourceFile", name="fmu.c")
    ElementTree.SubElement(build, "Library", name="m")
    return _document(root)


def _document(root: ElementTree.Element) -> str:
    ElementTree.indent(root)
    return f'<?xml version="1.0" encoding="UTF-8"?>\n{ElementTree.tostring(root, encoding="unicode")}\n'


def _root(model: FmuModel, standard: Standard) -> ElementTree.Element:
    """Return the description without variables."""
    token, state = ("instantiationToken", "FMUState") if standard == 3 else ("guid", "FMUstate")
    attributes = {"fmiVersion": f"{standard}.0", "modelName": model.name, token: model.token}
    attributes |= {"generationTool": f"mechsim {__version__}", "variableNamingConvention": "flat"}
    root = ElementTree.Element("fmiModelDescription", attributes)
    both = {
        "modelIdentifier": model.identifier,
        f"canGetAndSet{state}": "true",
        f"canSerialize{state}": "true",
    }
    exchange = ElementTree.SubElement(root, "ModelExchange", both)
    simulation = ElementTree.SubElement(root, "CoSimulation", both)
    simulation.set("canHandleVariableCommunicationStepSize", "true")
    if standard == 3:
        exchange.set("needsCompletedIntegratorStep", "false")
    else:
        root.set("numberOfEventIndicators", "0")
        exchange.set("completedIntegratorStepNotNeeded", "true")
        for element in (exchange, simulation):
            ElementTree.SubElement(ElementTree.SubElement(element, "SourceFiles"), "File", name="fmu.c")
    units = ElementTree.SubElement(root, "UnitDefinitions")
    used = {variable.unit for variable in model.variables}
    for name in filter(used.__contains__, UNITS):
        exponents = {base: str(exponent) for base, exponent in UNITS[name].items()}
        ElementTree.SubElement(ElementTree.SubElement(units, "Unit", name=name), "BaseUnit", exponents)
    categories = ElementTree.SubElement(root, "LogCategories")
    ElementTree.SubElement(categories, "Category", name="logStatusError")
    ElementTree.SubElement(root, "DefaultExperiment", startTime="0.0", stopTime=repr(model.duration))
    return root


def _description(model: FmuModel, standard: Standard) -> str:
    """Return modelDescription.xml."""
    root, first = _root(model, standard), model.first
    listed = ElementTree.SubElement(root, "ModelVariables")
    kinds = [kind for kind, variables in model.kinds.items() for _ in variables]
    for number, (variable, kind) in enumerate(zip(model.variables, kinds, strict=True)):
        attributes = {"name": variable.name, "valueReference": str(number)}
        attributes |= {"description": variable.description} if variable.description else {}
        attributes |= zip(("causality", "variability", "initial"), KINDS[kind].split(), strict=False)
        real = {"unit": variable.unit} if variable.unit else {}
        real |= {} if variable.start is None else {"start": repr(variable.start)}
        if kind == "DERIVATIVE":
            # variables are counted from 1 in FMI 2.0
            state = number - first["DERIVATIVE"] + first["STATE"]
            real["derivative"] = str(state if standard == 3 else state + 1)
        if standard == 3:
            ElementTree.SubElement(listed, "Float64", attributes | real)
        else:
            ElementTree.SubElement(ElementTree.SubElement(listed, "ScalarVariable", attributes), "Real", real)
    structure = ElementTree.SubElement(root, "ModelStructure")
    for new, old, start, end in (
        ("Output", "Outputs", "STATE", "VALUES"),
        ("ContinuousStateDerivative", "Derivatives", "DERIVATIVE", "OUTPUT"),
        ("InitialUnknown", "InitialUnknowns", "DERIVATIVE", "VALUES"),
    ):
        numbers = range(first[start], first[end])
        if standard == 3:
            for number in numbers:
                ElementTree.SubElement(structure, new, valueReference=str(number))
        elif numbers:
            unknowns = ElementTree.SubElement(structure, old)
            for number in numbers:
                ElementTree.SubElement(unknowns, "Unknown", index=str(number + 1))
    return _document(root)
