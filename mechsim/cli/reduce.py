"""Command `mechsim reduce`: the smallest scene that satisfies a tolerance at the tracked points."""

from dataclasses import MISSING
from typing import Annotated, Any

import typer

from mechsim.cli.command import Result, Without, command, output_file
from mechsim.cli.exit_codes import notes
from mechsim.cli.options import ControlOptions, DriveOptions
from mechsim.cli.output import number, print_table, print_text
from mechsim.cli.progress import progress
from mechsim.studies.reduction.search import ReducedModel
from mechsim.studies.reduction.search import reduce as reduce_model
from mechsim.studies.scene.scene import require_mjcf
from mechsim.units import option


@command
def reduce(
    model: Annotated[str, typer.Argument(metavar="FILE.xml", help="An MJCF file that MuJoCo loads.")],
    *,
    tolerance: str = option(MISSING, "Tolerance; a bare number is in m, with --by torque in N m."),
    by: str = option(
        "trajectory", "Error to keep: that of tracked points, or of efforts.", metavar="trajectory|torque"
    ),
    driven: Annotated[DriveOptions, Without("loops")],
    controls: ControlOptions,
    output: Annotated[str, output_file("Reduced scene to write: .xml.", ".xml")],
) -> Result:
    """Remove from a scene what the motion of its tracked points does not need.

    Its settings stay; `mechsim tune` finds cheaper ones.

    Examples:
    mechsim reduce gripper.xml --tolerance 10um --track fingertip -o reduced.xml
    mechsim reduce leg.xml --by torque --tolerance 0.01 -o reduced.xml
    """
    require_mjcf(model)
    with progress("reduce", None) as report:
        result = reduce_model(
            model,
            tolerance,
            by=by,
            ctrl=dict(controls.ctrl),
            output=output,
            progress=report,
            **driven.as_arguments(),
        )
    notes.extend(result.notes)
    data: dict[str, Any] = {**result.as_dict(), "output": output}
    return Result(data, lambda: _print(result, model), result.reached, [output])


def _print(reduced: ReducedModel, model: str) -> None:
    result, unit = reduced.reduction, reduced.unit
    rows = [(element.candidate.what, number(element.error, 2)) for element in result.left_out]
    print_table(f"{model}: what was removed, one after another", ("removed", f"error [{unit}]"), rows)
    for what in result.undone:
        print_text(f"restored, since the whole was beyond the tolerance: {what}")
    for motion, errors in zip(("its motion", "a second motion"), result.errors, strict=True):
        print_text(
            f"over {motion}: within {number(errors.by(result.by), 2)} {unit} of the full scene (tolerance "
            f"{number(reduced.tolerance, 3)} {unit}); efforts within {number(errors.torque, 2)}"
        )
    print_text(
        f"{number(result.speedup, 3)} times as fast: {number(1e3 * result.time / result.speedup, 3)} instead "
        f"of {number(1e3 * result.time, 3)} ms per simulated second; {result.tried} candidates tried"
    )
