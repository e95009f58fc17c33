"""A solver of configurations as an FMU: drivers are inputs, and coordinates, points and torques outputs."""

from collections.abc import Iterable

from mechsim.codegen.fmu import FmuModel, Variable
from mechsim.codegen.kinematics import INERTIA_NUMBERS
from mechsim.codegen.solver_code import SolverCode, c_header, template

# quantities of a coordinate -> what they are, and what follows the unit of the coordinate
MOTION = {"q": ("position", ""), "v": ("rate", "/s"), "a": ("acceleration", "/s2")}
# numbers of a link's inertia -> their unit
INERTIA = {
    "mass": "kg",
    **{f"centre.{axis}": "m" for axis in "xyz"},
    **{f"inertia.{axes}": "kg.m2" for axes in ("xx", "yy", "zz", "xy", "xz", "yz")},
}


def gravity_parameters(gravity: Iterable[float]) -> list[Variable]:
    """Return the acceleration of gravity as parameters."""
    return [
        Variable(f"gravity.{axis}", "m/s2", float(value)) for axis, value in zip("xyz", gravity, strict=True)
    ]


def kinematic_fmu(code: SolverCode) -> FmuModel:
    """Return a solver as an FMU."""
    assembly, mechanism = code.assembly, code.assembly.source.mechanism
    first = assembly.start.values[assembly.driven, 0].tolist()
    inputs = [
        Variable(
            f"{name}.{letter}", mechanism.unit(name) + per, start * (letter == "q"), f"{what} of a driver"
        )
        for name, start in zip(assembly.drivers, first, strict=True)
        for letter, (what, per) in MOTION.items()
    ]
    parameters: list[Variable] = []
    if code.inertias is not None:
        parameters = gravity_parameters(code.gravity) + [
            Variable(f"{link}.{name}", unit, value)
            for link, numbers in zip(code.formulas.links, code.inertias.tolist(), strict=True)
            for (name, unit), value in zip(INERTIA.items(), numbers, strict=True)
        ]
    # a ball has no angle, and a driver is an input
    balls = {*assembly.loops.tree.ball_indices}
    chosen = [
        (i, name)
        for i, name in enumerate(code.formulas.coordinates)
        if i not in balls and name in mechanism.coordinates and name not in assembly.drivers
    ]
    names = [*(name for _, name in chosen), *code.formulas.joints]
    outputs = [
        Variable(f"{name}.{letter}", mechanism.unit(name) + per, description=f"{what} of a joint")
        for name in names
        for letter, (what, per) in MOTION.items()
    ]
    outputs += [
        Variable(f"{point}.{prefix}{axis}", f"m{per}", description=f"{what} of a point")
        for point in code.formulas.points
        for (what, per), prefix in zip(MOTION.values(), ("", "v", "a"), strict=True)
        for axis in "xyz"
    ]
    if code.inertias is not None:
        outputs += [
            Variable(
                f"{name}.effort", mechanism.effort_unit(name).replace(" ", "."), description="of a driver"
            )
            for name in assembly.drivers
        ]
    flags = {
        "POINTS": bool(code.formulas.points),
        "JOINTS": bool(code.formulas.joints),
        "TORQUES": code.inertias is not None,
    }
    indices = ", ".join(str(i) for i, _ in chosen) or "0"
    lines = [
        c_header(code),
        f"enum {{ COORDINATES = {len(chosen)} }};",
        f"static const int COORDINATE[] = {{{indices}}};\n",
        template("fmu_kinematics.c", flags).replace("@", f"{code.prefix}_"),
    ]
    return FmuModel(mechanism.name, inputs, parameters, (), (), outputs, "\n".join(lines), 1.0)


assert len(INERTIA) == INERTIA_NUMBERS
