"""The reference data in the package: mechanisms in TOML and tables of their motion to 30 digits."""

import hashlib
import json
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from mechsim import files
from mechsim.errors import InputError
from mechsim.io.catalog import PACKAGE
from mechsim.mechanism.motion import PointMotion
from mechsim.numerics.arrays import Array

CHECKSUMS = "SHA256SUMS"
DRIVE_FORCE_PREFIXES = ("torque:", "force:")


@dataclass(frozen=True, slots=True)
class ReferenceTable:
    """The reference motion of a mechanism.

    Attributes:
        name: name of the mechanism.
        mechanism: path of its TOML file.
        speed: crank speed in [rad/s]; None under motion laws.
        first: crank angle in [rad], or under motion laws time in [s], (n,).
        points: tracked point -> its motion.
        drive_forces: driver -> torque in [N m] or force in [N], (n,).
    """

    name: str
    mechanism: Path
    speed: float | None
    first: Array
    points: Mapping[str, PointMotion]
    drive_forces: Mapping[str, Array]


def folder() -> Path:
    """Return the folder of the data, in an installed package or in the source tree."""
    inside = PACKAGE / "reference"
    return inside if inside.is_dir() else PACKAGE.parent / "reference"


def names(where: Path) -> list[str]:
    """Return the mechanisms in a folder of reference data."""
    return sorted(path.stem for path in (where / "data").glob("*.csv"))


def read(where: Path, name: str) -> ReferenceTable:
    """Return the table of a mechanism.

    Raises:
        InputError: if it is missing, or its checksum is wrong.
    """
    available = names(where)
    if name not in available:
        raise InputError(f"there are no reference data of {name!r}; choose from {', '.join(available)}")
    lines = (where / CHECKSUMS).read_text(encoding="utf-8").splitlines()
    sums = {path: digest for digest, _, path in (line.partition("  ") for line in lines)}
    paths = {
        path: where / path for path in (f"data/{name}.csv", f"mechanisms/{name}.toml", "datapackage.json")
    }
    for file_name, path in paths.items():
        if sums.get(file_name) != hashlib.sha256(path.read_bytes()).hexdigest():
            raise InputError(
                f"the checksum of {path} in {CHECKSUMS} is wrong; download the reference data again"
            )
    columns = files.read(paths[f"data/{name}.csv"])
    head = list(columns)
    package = json.loads(paths["datapackage.json"].read_text(encoding="utf-8"))
    speeds = {resource["path"]: resource["crank_speed"] for resource in package["resources"]}
    speed = speeds[f"data/{name}.csv"]
    motions = {
        point: [
            np.column_stack([columns[f"{point}.{rate}{axis}"] for axis in "xyz"]) for rate in ("", "v", "a")
        ]
        for point in (column.removesuffix(".ax") for column in head if column.endswith(".ax"))
    }
    return ReferenceTable(
        name=name,
        mechanism=paths[f"mechanisms/{name}.toml"],
        speed=None if speed is None else float(speed.split()[0]),
        first=columns[head[0]],
        points={point: PointMotion(*motion) for point, motion in motions.items()},
        drive_forces={
            resource.partition(":")[2]: column
            for resource, column in columns.items()
            if resource.startswith(DRIVE_FORCE_PREFIXES)
        },
    )
