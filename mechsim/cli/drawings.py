"""The command that plots."""

from typing import Annotated

import typer

from mechsim.cli.drawn import DRAWN, Asked
from mechsim.cli.options import Name, Sets, Speed, drive_of, speed_of, writable
from mechsim.cli.pictures import File
from mechsim.cli.roads import Road


def plot(
    name: Name,
    output: File,
    kind: Annotated[str, typer.Option(help=f"One of {', '.join(DRAWN)}.")] = "motion",
    points: Annotated[str | None, typer.Option(help="Tracked points, with commas; all if left out.")] = None,
    road: Road = "closed",
    speed: Speed = "600rpm",
    angle: Annotated[str, typer.Option(help="Crank angle of a velocity plan.")] = "0deg",
    stopped: Annotated[
        str, typer.Option(help="Crank stopped in a velocity plan: crank1 or crank2.")
    ] = "crank2",
    sets: Sets = None,
) -> None:
    """Plot motions, curves, transmission, errors, velocity plans, dynamics or studies: .svg, .pdf or .png.

    Kind precision takes 20 s to measure, kind stability minutes; `mechsim tradeoff` and `mechsim extremes`
    tell the numbers too.
    """
    from mechsim import plots, units
    from mechsim.errors import InputError

    form = plots.form_of(output)
    place = writable(output)
    if kind not in DRAWN:
        raise InputError(f"there is no plot {kind!r}; known are {', '.join(DRAWN)}")
    asked = Asked(
        drive=drive_of(name, sets),
        changed=bool(sets),
        road=road,
        speed=speed_of(speed),
        points=points.split(",") if points else None,
        angle=units.parse_angle(angle, "the crank angle"),
        stopped=stopped,
        form=form,
    )
    plots.write(place, DRAWN[kind](asked))
    typer.echo(f"wrote {output}")
