"""Command `mechsim show`: all that is known of a mechanism without a run."""

import math
from typing import Annotated, Any

import typer

from mechsim.analytic import catalog
from mechsim.cli.declared_options import spread
from mechsim.cli.options import DriveOptions, Json, Model, Sets, form_of
from mechsim.cli.output import print_json, print_table
from mechsim.cli.output_units import SI_UNITS, OutputUnits, Units, output_units
from mechsim.cli.unit_warnings import asked_angle
from mechsim.cli.verdict_text import found_in, in_json, print_findings
from mechsim.report.facts import OWN, facts
from mechsim.subjects import gallery
from mechsim.units import parse_angle

# part of the largest coordinate of a place below which one is rounding, and is printed as 0
ROUNDING = 1e-13


@spread
def show(
    model: Model,
    driven: DriveOptions,
    sets: Sets = None,
    angle: Annotated[
        str | None, typer.Option(help="List the assemblies at this crank angle; a bare number is rad.")
    ] = None,
    driver: Annotated[
        str | None, typer.Option(metavar="LINK", help="Take a planar chain apart for this driving link.")
    ] = None,
    units: Units = None,
    as_json: Json = False,
) -> None:
    """Show parameters, joints, mobility, crank range, dead centres, assemblies and Assur groups."""
    drive = form_of(model, sets, driven, still=True)
    shown = output_units(units, drive) or SI_UNITS
    at = None if angle is None else parse_angle(angle, "the crank angle")
    asked_angle("--angle", angle or "", drive)
    found = facts(drive, at, driver)
    scene = found_in(drive)
    if as_json:
        print_json(found | in_json(scene))
    else:
        _print_facts(found, shown)
        print_findings(scene)


def _print_facts(found: dict[str, Any], shown: OutputUnits) -> None:
    rows = [(n, _number(p["value"]), p["unit"], p["doc"]) for n, p in found["parameters"].items()]
    print_table(f"{found['name']}: {found['about']}", ("parameter", "value", "unit", "meaning"), rows)
    joints = [(j["name"], j["kind"], f"{j['links'][0]} - {j['links'][1]}") for j in found["joints"]]
    print_table("Joints", ("joint", "kind", "links"), joints)
    if found["couplings"]:
        rows = [(one["name"], _sum(one["driven"]), _polynomial(one)) for one in found["couplings"]]
        print_table("Couplings", ("coupling", "driven", "as a function"), rows)
    lines = [(line,) for line in found["mobility_explained"]]
    counted = found["mobility"]
    freedoms = counted["freedoms"] if isinstance(counted, dict) else counted
    print_table(f"Mobility W = {freedoms}", ("why",), lines)
    for name, program in found.get("programs", {}).items():
        typer.echo(f"program of {name}: {program}")
    if "crank_range" in found:
        _print_crank(found)
        _print_assemblies(found, shown)
    elif found["duration"] is not None:
        typer.echo(f"the programs run for {found['duration']:.6g} s")


def _print_crank(found: dict[str, Any]) -> None:
    """Say how far the crank goes, and what is known of the way."""
    reach = found["crank_range"]
    if reach != "full turn":
        arcs = found["crank_ranges"]
        reach = ", ".join(f"{math.degrees(a):.4f} to {math.degrees(b):.4f} deg" for a, b in arcs) or "nowhere"
    typer.echo(f"crank range: {reach}")
    if found["dead_centres"]:
        ends = ", ".join(f"{math.degrees(a):.4f} deg" for a in found["dead_centres"])
        typer.echo(f"dead centres of the crank: {ends}")
    if found["change_points"]:
        _print_change_points(found)
    least = found["transmission_angle"]
    if least is not None:
        typer.echo(
            f"transmission angle: at least {math.degrees(least['least']):.2f} deg, "
            f"at crank angle {math.degrees(least['at_angle']):.1f} deg"
        )
    elif found["about"] == OWN:
        typer.echo("transmission angle: known for mechanisms of the catalogue only")
    for line in found["assur_explained"]:
        typer.echo(line)


def _print_assemblies(found: dict[str, Any], shown: OutputUnits) -> None:
    rows: list[tuple[str, ...]] = []
    places = [place for assembly in found["assemblies"] for place in assembly["points"].values()]
    least = ROUNDING * max((abs(value) for place in places for value in place), default=0.0)
    for assembly in found["assemblies"]:
        names = ", ".join(f"{k} {v:+d}" for k, v in assembly.items() if isinstance(v, int))
        for point, place in assembly["points"].items():
            kept = [value / shown.converted("m")[0] if abs(value) > least else 0.0 for value in place]
            rows.append((names, point, *(f"{value:.9g}" for value in kept)))
    at = f"{math.degrees(found['angle']):.6g} deg"
    if not rows:
        passes = any(low <= found["angle"] <= high for low, high in found["crank_ranges"])
        why = (
            "its pose there is singular, as where links lie flat on each other"
            if passes
            else "the crank cannot stand there"
        )
        typer.echo(f"no assembly at crank angle {at}: {why}")
        return
    title = f"Assemblies at crank angle {at}"
    print_table(title, ("assembly", "point", *(shown.label(axis, "m") for axis in "xyz")), rows)


def _print_change_points(found: dict[str, Any]) -> None:
    at = ", ".join(f"{math.degrees(a):.4f} deg" for a in found["change_points"])
    typer.echo(
        f"change points of the crank: {at}: there assemblies meet and bars lie on each other; the motion "
        "goes on smoothly, or back with --change-point branch; a real one needs a second crank or a flywheel"
    )
    if found["turns_to_come_round"] > 1:
        typer.echo(f"it stands as before after {found['turns_to_come_round']} turns of the crank")


def _sum(terms: dict[str, float]) -> str:
    signs = {1.0: "", -1.0: "-"}
    return _added([f"{signs.get(weight, f'{weight:.9g} ')}{name}" for name, weight in terms.items()])


def _polynomial(coupling: dict[str, Any]) -> str:
    """Return p(x) in words, x being the driver's side."""
    x = _sum(coupling["driver"])
    powers = ["", *(f" ({x})" if k == 1 else f" ({x})^{k}" for k in range(1, 6))]
    parts = zip(coupling["coefficients"], powers, strict=False)
    return _added([f"{value:.9g}{power}" for value, power in parts if value]) or "0"


def _added(terms: list[str]) -> str:
    return " + ".join(terms).replace(" + -", " - ")


def _number(value: Any) -> str:
    if isinstance(value, list | tuple):
        return ", ".join(_number(item) for item in value)
    return f"{value:.9g}" if isinstance(value, float) else str(value)


def list_mechanisms(as_json: Json = False) -> None:
    """List the mechanisms of the catalogue and of the gallery."""
    described = {name: (drive.__doc__ or "").splitlines()[0] for name, drive in catalog.DRIVES.items()}
    shown = {name: gallery.description(path) for name, path in gallery.files().items()}
    if as_json:
        print_json({"mechanisms": described, "gallery": shown})
        return
    print_table("The catalogue", ("name", "what it is"), described.items())
    print_table(f"The gallery, in {gallery.folder()}", ("name", "what it is"), shown.items())
