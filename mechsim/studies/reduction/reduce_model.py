"""Reduce a model to the smallest scene within a tolerance for its tracked points, written as MJCF."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from os import PathLike, fspath
from pathlib import Path
from typing import Any, cast, get_args

from mechsim import files
from mechsim.numerics.resources import Progress, no_progress
from mechsim.studies.reduction.search import By, Reduction, reduce_scene, with_comment
from mechsim.studies.scene.errors import UNITS, tolerance_in_si
from mechsim.studies.scene.open_scene import open_scene, scene_file
from mechsim.studies.scene.scene import spec_of
from mechsim.units import Unit


@dataclass(frozen=True)
class ReducedModel:
    """A reduced model.

    Attributes:
        reduction: removed elements, with errors and cost.
        tolerance: in SI.
        text: reduced MJCF file.
        notes: changes made to read the file.
    """

    reduction: Reduction
    tolerance: float
    text: str
    notes: tuple[str, ...]

    @property
    def unit(self) -> Unit:
        """Unit of the tolerance."""
        return UNITS[self.reduction.by]

    @property
    def reached(self) -> bool:
        """Whether the reduced model satisfies the tolerance over both motions."""
        return self.reduction.kept(self.tolerance)

    def __str__(self) -> str:
        worst = max(errors.by(self.reduction.by) for errors in self.reduction.errors)
        return f"{self.reduction.speedup:.3g} times as fast, error {worst:.2g} {self.unit}"

    __repr__ = __str__

    def as_dict(self) -> dict[str, Any]:
        """Return the output of `mechsim reduce --json` without the path of the file."""
        result = self.reduction
        first, second = result.errors
        return {
            **files.attributes(result, "speedup", "tried", "undone", "by"),
            "left_out": [
                files.attributes(item.candidate, "what", "category") | {"error": item.error}
                for item in result.left_out
            ],
            "error": max(first.by(result.by), second.by(result.by)),
            "motion": first,
            "second_motion": second,
            "ms_per_s": {"full": 1e3 * result.time, "reduced": 1e3 * result.time / result.speedup},
            **files.attributes(self, "tolerance", "unit"),
        }


def reduce(
    model: Any,
    tolerance: float | str,
    *,
    by: str = "trajectory",
    ctrl: Mapping[str, str | float] | None = None,
    track: Iterable[str] = (),
    output: str | PathLike[str] | None = None,
    progress: Progress = no_progress,
    **options: Any,
) -> ReducedModel:
    """Return the smallest scene that satisfies a tolerance for the tracked points.

    Args:
        model: an MJCF file, or any input of `load`, which is then written as MJCF.
        tolerance: in [m] or text, such as "10um"; by torque in [N m].
        by: "trajectory" (of tracked points) or "torque".
        ctrl: actuator -> its control, as for `tune`.
        track: bodies, sites, "P,Q" for two of them, or "P,BODY@x,y,z" for a new point; by default all.
        output: path of the reduced MJCF file; None writes none.
        progress: callback with a description and the completed fraction.
        options: `drive`, `lock`, `lock_others`, `fix_base`, `key` and `duration`, as for `load`.

    Raises:
        InputError: for an invalid model, motion or tolerance.
        AssemblyError: for loops that do not close.

    Example:
        >>> small = ms.reduce("gripper.xml", "10um", track=["fingertip"], output="small.xml")
        >>> small.reduction.speedup, [element.candidate.what for element in small.reduction.left_out]
    """
    limit = tolerance_in_si(tolerance, by, get_args(By))
    # "P,Q" names two points, "P,BODY@x,y,z" one
    points = [name for text in track for name in ([text] if "@" in text else text.split(","))]
    with scene_file(model) as path:
        scene, notes = open_scene(path, ctrl=ctrl, track=points, **options)
        keep = {name for text in points for name in text.partition("@")[0].split(",")} | set(scene.tracked)
        result = reduce_scene(scene, spec_of(scene), limit, keep=keep, by=cast(By, by), progress=progress)
        text = with_comment(result, Path(path).name, limit, UNITS[by])
    if output is not None:
        with files.atomic_path(Path(fspath(output))) as unfinished:
            unfinished.write_text(text, encoding="utf-8")
    return ReducedModel(result, limit, text, notes)
