"""Commands `mechsim list` and `mechsim show`: the mechanisms, and the properties of one without a run."""

import math
from collections.abc import Mapping
from itertools import islice
from typing import Annotated, Any

import typer

from mechsim.cli import output
from mechsim.cli.command import Result, Stated, Without, command
from mechsim.cli.finding_text import findings_in_json, kind, print_findings
from mechsim.cli.options import ModelOptions, warn_about_angle
from mechsim.cli.output import Value, in_colour, number, print_table, print_text, without_noise
from mechsim.errors import LISTED
from mechsim.io import gallery
from mechsim.io.scene_findings import scene_findings
from mechsim.kinematics.loops.mobility import Determinacy
from mechsim.kinematics.solvers import KinematicSolver
from mechsim.mechanism.joints import Coupling
from mechsim.report.facts import facts
from mechsim.units import option, parse_angle

# significant digits of parameters and coupling coefficients, which are inputs
INPUT_DIGITS = 6


@command
def list_mechanisms() -> Result:
    """List the mechanisms of the catalogue, which have closed forms, and of the gallery.

    Examples:
    mechsim list
    mechsim list --json
    """
    mechanisms: Any = gallery.list()

    def text() -> None:
        head = ("name", "what it is")
        print_table("Catalogue (closed forms in Python)", head, mechanisms["mechanisms"].items())
        print_table("Gallery (TOML files)", head, mechanisms["gallery"].items())
        print_table("Machines (TOML files with forces)", head, mechanisms["machines"].items())
        print_text(f"files: {gallery.folder()}, and machines next to it")

    return Result(mechanisms, text)


@command
def show(
    source: Annotated[ModelOptions, Without("track", "duration")],
    stated: Stated,
    angle: str | None = option(None, "List the assemblies at this crank angle; a bare number is rad."),
    units: output.Units = None,
) -> Result:
    """Show parameters, joints, mobility, crank range, dead centres, assemblies and Assur groups.

    Examples:
    mechsim show rssr --angle 30deg
    mechsim show gripper.xml --units mm,deg
    """
    solver = source.load(still=True)
    shown = output.output_units(units, solver) or output.SI_UNITS
    radians = None if angle is None else parse_angle(angle, "the crank angle")
    warn_about_angle("--angle", angle or "", solver.written.angle)
    data = facts(solver, radians)
    without = "without a crank that alone determines the motion"
    stated.exclude(["angle", "units"], without, "crank_range" not in data)
    findings = scene_findings(solver)

    def text() -> None:
        mobility = data["mobility"]
        dofs = mobility.dofs if isinstance(mobility, Determinacy) else None
        typer.echo(in_colour(f"{data['name']}  {kind(solver, dofs)}"))
        print_text(data["about"])
        print_findings(findings)
        _print_structure(data, solver)
        if "crank_range" in data:
            _print_crank(data)
        elif data["duration"] is not None:
            typer.echo(f"duration of the motion laws: {number(data['duration'])} s")
        if "assemblies" in data:
            _print_assemblies(data, shown)

    return Result(data | findings_in_json(findings), text)


def _print_structure(data: dict[str, Any], solver: KinematicSolver) -> None:
    declared, mechanism = solver.written, solver.mechanism
    rows = [(name, _text(row["value"]), row["unit"], row["doc"]) for name, row in data["parameters"].items()]
    if any(doc for *_, doc in rows):
        print_table("Parameters", ("name", "value", "unit", "meaning"), rows)
    else:
        title = f"Parameters, in the units of the file ({declared.length}, {declared.angle})"
        print_table(title, ("name", "value"), [row[:2] for row in rows])
    joints = [
        (joint.name, mechanism.contacts.get(joint.name, joint).kind, " - ".join(joint.links))
        for joint in data["joints"]
    ]
    print_table("Joints", ("joint", "kind", "links"), joints)
    couplings = [(law.name, _sum(law.left_terms), _polynomial(law)) for law in data["couplings"]]
    print_table("Couplings", ("coupling", "driven", "equals"), couplings)
    belts = [
        (name, belt["length"], ", ".join(map(_degrees, belt["wraps"])))
        for name, belt in data["belts"].items()
    ]
    print_table("Belts", ("belt", "length [m]", "wrap angles [deg], from the driver on"), belts)
    limits = [
        (name, *("none" if end is None else _text(end) for end in ends), mechanism.unit(name))
        for name, ends in data["limits"].items()
    ]
    print_table("Limits", ("coordinate", "lower", "upper", "unit"), limits)
    typer.echo(in_colour("Mobility"))
    for line in data["mobility_explained"]:
        print_text(f"  {line}")
    for name, law in data.get("motion_laws", {}).items():
        print_text(f"motion law of {name}: {law}")


def _print_crank(data: dict[str, Any]) -> None:
    """Print the range of the crank, its dead centres and its change points."""
    crank_range = data["crank_range"]
    if crank_range != "full turn":
        arcs = [f"{_degrees(low)} to {_degrees(high)} deg" for low, high in data["crank_ranges"]]
        crank_range = ", ".join(arcs) or "nowhere"
    print_text(f"crank range: {crank_range}")
    if data["dead_centres"]:
        print_text(f"dead centres of the crank: {', '.join(map(_degrees, data['dead_centres']))} deg")
    if data["change_points"]:
        print_text(
            f"change points of the crank: {', '.join(map(_degrees, data['change_points']))} deg, where two "
            "assemblies meet. The motion passes them smoothly, or stays in its assembly with "
            "--change-point branch. A real linkage needs a second crank or a flywheel there"
        )
        if data["turns_to_come_round"] > 1:
            typer.echo(f"the motion repeats after {data['turns_to_come_round']} turns of the crank")
    if data["transmission_angle"] is not None:
        least, position = (_degrees(data["transmission_angle"][name]) for name in ("least", "at_angle"))
        typer.echo(f"transmission angle: at least {least} deg (at crank angle {position} deg)")
    if data["assur_explained"]:
        typer.echo(in_colour("Assur groups"))
    for line in data["assur_explained"]:
        print_text(f"  {line}")


def _print_assemblies(data: dict[str, Any], shown: output.OutputUnits) -> None:
    assemblies = data["assemblies"]
    where = f"at crank angle {_degrees(data['angle'])} deg" if "angle" in data else "at the start"
    if not assemblies:
        in_range = any(low <= data["angle"] <= high for low, high in data["crank_ranges"])
        reason = "the configuration is singular there" if in_range else "outside the crank's range"
        typer.echo(f"no assembly {where}: {reason}")
        return
    points = [x for assembly in assemblies for point in assembly["points"].values() for x in point]
    factor, _ = shown.converted("m")
    coordinates = iter(without_noise([x / factor for x in points]))
    rows: list[list[Value]] = []
    for i, assembly in enumerate(assemblies[:LISTED], 1):
        chosen = [f"{name} {value:+d}" for name, value in assembly.items() if isinstance(value, int)]
        name = ", ".join(chosen) or (str(i) if len(assemblies) > 1 else "")
        rows += [[name, point, *islice(coordinates, 3)] for point in assembly["points"]]
    head = ["assembly", "point", *(shown.label(axis, "m") for axis in "xyz")]
    # a mechanism with one assembly needs no column for it
    first = 0 if any(row[0] for row in rows) else 1
    print_table(f"Assemblies {where}", head[first:], [row[first:] for row in rows])
    if len(assemblies) > LISTED:
        typer.echo(f"and {len(assemblies) - LISTED:,} more, which --json lists")
    print_text(
        f"{'complete' if data['assemblies_complete'] else 'perhaps more'}: {data['assemblies_reason']}"
    )
    for sentence in data["assembly_families"]:
        print_text(f"a continuous family of further assemblies: {sentence}")


def _degrees(angle: float) -> str:
    degrees = round(math.degrees(angle), 6)
    return number(degrees, 4 if abs(degrees) < 1e4 else 6)


def _sum(terms: Mapping[str, float]) -> str:
    return _added([_term(weight, name) for name, weight in terms.items()])


def _polynomial(coupling: Coupling) -> str:
    """Return p(x) as text; x is the driver's side."""
    if coupling.function is not None:
        return f"{coupling.function.text}, q = {_sum(coupling.right_terms)}"
    x = _sum(coupling.right_terms)
    x = x if list(coupling.right_terms.values()) == [1.0] else f"({x})"
    powers = ["", x, *(f"{x}^{k}" for k in range(2, 6))]
    terms = zip(coupling.coefficients, powers, strict=False)
    return _added([_term(value, power) for value, power in terms if value]) or "0"


def _term(value: float, factor: str) -> str:
    """Return a product as text, without a factor of one."""
    sign = {1.0: "", -1.0: "-"}.get(value) if factor else None
    return f"{_text(value)} {factor}".rstrip() if sign is None else f"{sign}{factor}"


def _added(terms: list[str]) -> str:
    return " + ".join(terms).replace(" + -", " - ")


def _text(value: Any) -> str:
    if isinstance(value, list | tuple):
        return ", ".join(map(_text, value))
    return number(value, INPUT_DIGITS) if isinstance(value, float) else str(value)
