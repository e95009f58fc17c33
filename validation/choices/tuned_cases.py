"""Scenes, motions and tolerances of the study tuned_scenes.py."""

import tomllib
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

import mujoco
import numpy as np

from mechsim.cli.options import ControlOptions, DriveOptions
from mechsim.io.readers import load
from mechsim.mechanism.mechanism import Mechanism
from mechsim.mechanism.scene import Scene
from mechsim.simulation.mjcf.compiling import to_xml
from mechsim.simulation.mjcf_reader.parsed_file import parse_file
from mechsim.studies.export import exported

# names in the catalogue, and files with controls of their actuators; without controls their drivers swing
PUBLIC = tomllib.loads(Path(__file__).with_suffix(".toml").read_text(encoding="utf-8"))
CATALOGUE = PUBLIC.pop("catalogue")
# for every scene: error measure, tolerance relative to its size, speed factor of its motion
CASES: list[tuple[Literal["closure", "trajectory"], float, float]] = PUBLIC.pop("cases")


@dataclass(frozen=True)
class SceneFile:
    """A scene to tune.

    Attributes:
        name: of the scene.
        path: of its file.
        mechanism: of the scene.
        controls: actuator -> control over time, with {rate} as speed factor.
    """

    name: str
    path: Path
    mechanism: Mechanism
    controls: dict[str, str]

    def motion(self, rate: float) -> tuple[DriveOptions, ControlOptions]:
        """Return the motion: controls of actuators, a revolution of the crank, or a swing of every driver."""
        if self.controls:
            pairs = tuple(
                (name, control.replace("{rate}", f"{rate:g}")) for name, control in self.controls.items()
            )
            return DriveOptions(), ControlOptions(ctrl=pairs)
        if self.mechanism.drivers == ("crank",):
            return DriveOptions(drive=(("crank", f"{60.0 * rate:g}rpm"),)), ControlOptions()
        swings = tuple(_swing(self, name, rate) for name in self.mechanism.drivers)
        return DriveOptions(drive=swings), ControlOptions()


def _swing(scene: SceneFile, name: str, rate: float) -> tuple[str, str]:
    """Return a motion law that swings a driver from its start, within its limits, and back."""
    subject = load(str(scene.path), drive=dict.fromkeys(scene.mechanism.drivers, "0.1*t"))
    start = subject.mechanism.guess_coordinates[name]
    # smaller amplitudes with several drivers avoid singular configurations
    rotates = subject.mechanism.unit(name) == "rad"
    amplitude = (
        0.3 / len(subject.mechanism.drivers) if rotates else 0.1 * subject.mechanism.characteristic_length
    )
    low, high = subject.source.limits.get(name, (-np.inf, np.inf))
    amplitude = amplitude if start + amplitude <= high else -min(amplitude, start - low)
    return name, f"{start!r} + {0.5 * amplitude!r}*(1-cos({rate:g}*2*pi*t))"


def scene_files(folder: Path | None, work: Path, only: set[str]) -> Iterator[SceneFile]:
    """Yield the scenes; write those of the catalogue into a folder.

    Args:
        folder: with clones of the repositories of `PUBLIC`; None for none.
        work: folder for written files.
        only: names; empty for all.
    """
    for name in CATALOGUE:
        if only and name not in only:
            continue
        mechanism, path = load(name).mechanism, work / f"{name}.xml"
        path.write_text(to_xml(exported(mechanism, Scene())))
        yield SceneFile(name, path, mechanism, {})
    for name, scene in PUBLIC.items() if folder else ():
        file, path = scene["file"], folder / scene["file"]
        if only and name not in only:
            continue
        if not path.is_file():
            print(f"{name}: {file} is missing: skipped")
            continue
        path = _loadable(path, work / f"{name}.xml".replace(" ", "-"))
        yield SceneFile(name, path, load(str(path)).mechanism, scene.get("controls", {}))


def _loadable(path: Path, path_without_meshes: Path) -> Path:
    """Return the path of a file that plain MuJoCo loads, without its missing meshes."""
    try:
        mujoco.MjModel.from_xml_path(str(path))
    except ValueError:
        path_without_meshes.write_text(parse_file(str(path))[0].to_xml())
        return path_without_meshes
    return path
