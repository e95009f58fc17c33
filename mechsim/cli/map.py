"""Command `mechsim map`: the map from motors to joints of a closed-loop model, over a grid."""

from dataclasses import MISSING
from typing import Annotated, Any

import numpy as np

from mechsim.cli.closed_model import ClosedModelOptions, closed_model
from mechsim.cli.command import Result, command, output_file
from mechsim.cli.options import joint_ranges
from mechsim.cli.output import Value, number, print_table, print_text
from mechsim.cli.progress import progress
from mechsim.files import atomic_path, attributes
from mechsim.simulation.joint_map import JointMap
from mechsim.studies.robots.joint_map import TOLERANCE, MapComparison, compare_with_loop_equations, joint_map
from mechsim.units import option


@command
def map_joints(
    source: ClosedModelOptions,
    *,
    inputs: str = option(
        MISSING,
        "Input joints and their ranges (left=-20deg:20deg). Default range: the joint limits.",
        name="--from",
        metavar="J[=A:B],...",
    ),
    outputs: str = option(
        MISSING,
        "Output joints, or coordinates x, y, z, rx, ry, rz of a body or a site (foot.rz).",
        name="--to",
        metavar="NAME,...",
    ),
    points: int = option(21, "Grid points along each input."),
    degree: int | None = option(None, "Also fit polynomials of this total degree to the outputs."),
    output: Annotated[str, output_file("Map to write: .npz.", ".npz")],
) -> Result:
    """Map motors to joints of a closed-loop model: positions, Jacobians, torques, inertia over a grid.

    The loop equations check the map at some of its points; a difference ends with exit code 1.

    Examples:
    mechsim map ankle.xml --from left,right --to pitch,roll -o map.npz
    mechsim map four_bar --from crank=20deg:80deg --to rocker -o map.npz --json
    """
    ranges = joint_ranges("--from", inputs)
    listed = list(dict.fromkeys(outputs.split(",")))
    started, model, options = closed_model(source)
    with progress("map", None) as report:
        grid: dict[str, Any] = {"points": points, "degree": degree, "fix_base": source.fix_base}
        table = joint_map(started, ranges, listed, progress=report, **grid)
    comparison = compare_with_loop_equations(table, model, **options)
    with atomic_path(output) as temporary, temporary.open("wb") as file:
        np.savez(file, **table.arrays())  # type: ignore[arg-type]
    data: dict[str, Any] = {
        "output": output,
        "inputs": list(table.inputs),
        "outputs": list(table.outputs),
        "points": len(table.input),
        "reached": table.reached,
        "locked": dict(table.locked),
        "differences": attributes(comparison, "output", "jacobian", "jacobian_derivative"),
        "passed": comparison.passed,
    }
    if fit := table.polynomials:
        data["polynomials"] = {
            name: {"position": float(position), "torque": float(torque)}
            for name, position, torque in zip(
                table.outputs, fit.position_error, fit.torque_error, strict=True
            )
        }
    return Result(data, lambda: _print(table, comparison, source.locks_others), comparison.passed, [output])


def _print(table: JointMap, comparison: MapComparison, lock_others: bool) -> None:
    """Print the reached points, the ranges, and the errors of map and polynomials."""
    jacobian = np.moveaxis(np.abs(table.jacobian), 1, 0)
    head = ["output", "lowest", "highest", "largest ratio"]
    rows: list[list[Value]] = [
        [name, float(values.min()), float(values.max()), float(ratio.max())]
        for name, values, ratio in zip(table.outputs, table.output.T, jacobian, strict=True)
    ]
    if fit := table.polynomials:
        head += ["polynomial off by", "its torque by"]
        errors = zip(fit.position_error.tolist(), fit.torque_error.tolist(), strict=True)
        rows = [[*row, *error] for row, error in zip(rows, errors, strict=True)]
    print_table(f"{len(table.input)} points, {table.reached:.1%} of the grid; SI units", head, rows)
    if table.locked and not lock_others:
        joints = ", ".join(f"{name} at {number(round(value, 12))}" for name, value in table.locked.items())
        print_text(f"Neither inputs nor loops determine these joints, which stay where they are: {joints}")
    print_text(
        f"Loop equations at {comparison.points} points: outputs differ by {comparison.output:.1e}, "
        f"Jacobian by {comparison.jacobian:.1e}, its derivative by {comparison.jacobian_derivative:.1e} "
        f"({'within' if comparison.passed else 'beyond'} the tolerance of {TOLERANCE:.0e})"
    )
