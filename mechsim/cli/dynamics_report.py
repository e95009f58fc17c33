"""What `mechsim dynamics` reports: JSON, peaks, masses, tolerances and comparisons."""

from collections.abc import Callable, Mapping, Sequence
from typing import Annotated, Any

import numpy as np
import typer

from mechsim import files
from mechsim.cli.command import PLOTS, TABLES, Result, one_of_each
from mechsim.cli.load_options import print_masses
from mechsim.cli.output import Value, number, print_table, print_text, without_noise
from mechsim.cli.verdict_text import print_verdicts
from mechsim.compare.checks import Verdict
from mechsim.errors import FrictionError, InputError
from mechsim.kinetics import DynamicModel, InverseDynamics
from mechsim.mechanism.links import GROUND
from mechsim.mechanism.motion_laws import MIN_TURNS
from mechsim.numerics.arrays import Array
from mechsim.pictures import plots
from mechsim.report.facts import study_facts

# limits of rows and turns
MAX_ROWS, MAX_TURNS = 10_000_000, 1e4
# after the names of forces that rigid links leave undetermined
UNDETERMINED = " *"
UNITS = {"force": "N", "moment": "N m"}
# name of a quantity, its peak as in JSON, and its unit
Peak = tuple[str, dict[str, Any], str]
Verbose = Annotated[bool, typer.Option("-v", "--verbose", help="List all checks and all masses.")]


def require_method(method: str | None, *methods: str) -> None:
    """Raise InputError for an unknown method of MuJoCo."""
    if method not in (None, *methods):
        raise InputError(f"there is no --method {method!r}; choose from {', '.join(methods)}")


def require_samples(samples: int) -> None:
    """Raise InputError for an invalid number of rows."""
    if not 2 <= samples <= MAX_ROWS:
        raise InputError(f"--samples is {samples}; give 2 to {MAX_ROWS}")


def require_turns(turns: float) -> None:
    """Raise InputError for an invalid number of turns of the crank."""
    if not MIN_TURNS <= abs(turns) < MAX_TURNS:
        raise InputError(f"--turns is {turns:g}; give {MIN_TURNS:g} to {MAX_TURNS:g} either way")


def write_outputs(
    paths: Sequence[str] | None, columns: Callable[[], Mapping[str, Array]], figure: Callable[[], Any]
) -> None:
    """Write the table and the plot for which -o names a path."""
    table, plot = one_of_each(paths, TABLES, PLOTS)
    if table is not None:
        files.write_table(table, columns())
    if plot is not None:
        plots.write(plot, figure())


def verdict_data(verdict: Verdict | None, method: str) -> dict[str, Any]:
    """Return the entries of a comparison by a method of MuJoCo in a JSON object."""
    if verdict is None:
        return {"passed": None, "outcome": None, "method": "none", "checks": []}
    return {"passed": verdict.passed, "outcome": verdict.outcome, "method": method, "checks": verdict.checks}


def without_solution(error: FrictionError) -> Result:
    """Return the result of a motion whose friction has no unique solution."""
    data = verdict_data(None, "none") | {"passed": False, "outcome": error.outcome, "reason": str(error)}
    text = f"{error.outcome.upper()}: {error}"
    return Result(data, lambda: print_text(text), passed=False)


def with_masses(model: DynamicModel, result: Result, verbose: bool | None = None) -> Result:
    """Return a result with name, masses and gravity of its mechanism."""
    gravity = model.forces.gravity

    def text() -> None:
        result.text()
        print_masses(model.masses, verbose)
        print_text(f"gravity: {', '.join(map(number, gravity))} m/s2" if any(gravity) else "gravity: none")

    data = {"mechanism": model.mechanism.name, "masses": model.masses, "gravity": gravity, **result.data}
    return Result(data, text, result.passed)


def print_comparison(verdict: Verdict | None, note: str = "", *, verbose: bool) -> None:
    """Print the comparison with MuJoCo."""
    if verdict is None:
        typer.echo("not compared with MuJoCo")
    else:
        print_verdicts({"against MuJoCo": verdict}, verbose=verbose)
    print_text(note)


def print_peaks(name: str, study: InverseDynamics) -> None:
    """Print peaks of torques, reactions, coupling efforts and shaking forces."""
    facts = study_facts(study)
    alone = " alone" if facts["actuators"] else ""
    drives = {f"drive of {joint}{alone}": effort for joint, effort in facts["drives"].items()}
    drives = drives or {f"drive torque{alone}": facts["torque"] | {"unit": "N m"}}
    drives |= {f"actuator {joint}": effort for joint, effort in facts["actuators"].items()}
    peaks: list[Peak] = [(what, peak, peak["unit"]) for what, peak in drives.items()]
    notes: list[str] = []
    peaks += [
        peak
        for joint, reaction in facts["reactions"].items()
        for peak in _reaction_peaks(f"of joint {joint}", reaction)
    ]
    for joints, reaction in facts["sums"].items():
        peaks += _reaction_peaks(f"sum of {joints}", reaction)
        undetermined = ", ".join(reaction["not_determined"])
        without = f"; without {undetermined}, which are undetermined" if undetermined else ""
        notes.append(f"sum of {joints}: moment about the point of the first{without}")
    for coupling, effort in facts["couplings"].items():
        kind = "torque" if effort["unit"] == "N m" else "force"
        if effort["by"] == "teeth":
            peaks.append((f"teeth of {coupling} on {effort['links'][0]}", effort["force"], "N"))
        if effort["by"] != "thread":
            peaks.append((f"{kind} of coupling {coupling}", effort["effort"], effort["unit"]))
        if effort["by"] == "ideal transmission":
            notes.append(f"{coupling}: ideal transmission: acts in reverse on {', '.join(effort['links'])}")
        if not effort["determined"]:
            notes.append(f"not determined by rigid links: coupling {coupling}")
    peaks.append(("shaking force on the frame", facts["shaking_force"], "N"))
    peaks.append(("shaking moment about the origin", facts["shaking_moment"], "N m"))
    largest = without_noise([peak["largest"] for _, peak, _ in peaks])
    rows: list[tuple[Value, ...]] = []
    for (what, peak, unit), value in zip(peaks, largest, strict=True):
        instant = peak["at_time"] if "at_time" in peak else np.rad2deg(peak["at_angle"])
        mean, rms = without_noise([peak.get("mean", 0.0), peak.get("rms", 0.0)])
        statistics = (mean, rms) if "rms" in peak else (None, None)
        rows.append((what, value, unit, instant if value else None, *statistics))
    kind, at_unit = ("drivers", "s") if facts["drives"] else ("crank", "deg")
    head = ("quantity", "largest", "unit", f"at [{at_unit}]", "mean", "rms")
    print_table(f"{name}: prescribed {kind}", head, rows)
    if any(what.endswith(UNDETERMINED) for what, _, _ in peaks):
        notes.append(f"{UNDETERMINED.strip()} of minimum norm: rigid links leave it undetermined")
    for note in [*_undetermined(facts["reactions"]), *notes]:
        print_text(note)


def _reaction_peaks(what: str, reaction: Mapping[str, Any]) -> list[Peak]:
    """Return the rows of a force and moment; undetermined ones are marked."""
    # a joint may have the name of its link
    on = "the frame" if reaction["on"] == GROUND else f"link {reaction['on']}"
    return [
        (f"{kind} {what} on {on}{'' if reaction[kind]['determined'] else UNDETERMINED}", reaction[kind], unit)
        for kind, unit in UNITS.items()
    ]


def _undetermined(reactions: dict[str, Any]) -> list[str]:
    """Return the reaction components that rigid links do not determine, with their joints."""
    joints: dict[str, list[str]] = {}
    for joint, reaction in reactions.items():
        partly = reaction["partly_determined"]
        wholly = [name for name in reaction["not_determined"] if name not in partly]
        for words, names in (("not determined", wholly), ("partly determined", partly)):
            if names:
                joints.setdefault(f"{words} by rigid links: {', '.join(names)}", []).append(joint)
    return [f"{text} of {', '.join(names)}" for text, names in joints.items()]
