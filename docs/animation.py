"""Draw the two animations of the README.

docs/gripper.gif: the parallel gripper, and as a dark ghost the formula with an arm that is 1 mm short.
docs/row.gif: six mechanisms in a row.

Run: python docs/animation.py
"""

from dataclasses import replace
from pathlib import Path

import numpy as np
from PIL import Image

import mechsim as ms
from mechsim.pictures.render import Look, frames
from mechsim.pictures.render.drawing import Picture

FOLDER = Path(__file__).parent
ROW = ("humanoid_ankle", "stewart_gough", "looper", "jansen", "planetary_gear", "delta_robot")
# largest and smallest angle of the gripper's driver in [rad]: open by 85 mm, and almost closed
OPEN, CLOSED = np.deg2rad([32.0, 82.0])
COUNT, MILLISECONDS = 36, 60
GRIPPER = Look(
    size=(480, 360), labels=False, magnify=10.0, caption="formula short_arm: arm 56 mm instead of 57 mm"
)
SMALL = Look(size=(160, 120), labels=False, notes=False)
PHASES = 2.0 * np.pi * np.arange(COUNT) / COUNT


def gripper(arm: str) -> ms.Motion:
    """Return one cycle of a gripper with an arm of this length, at the same angles of its driver."""
    angles = 0.5 * (OPEN + CLOSED) - 0.5 * (CLOSED - OPEN) * np.cos(PHASES)
    return ms.load("parallel_gripper", set={"arm": arm}).solve(angles)


def one_cycle(name: str) -> list[Picture]:
    """Return the frames of one revolution, or of the motion laws of several drivers."""
    model = ms.load(name)
    laws = model.motion_laws
    motion = model.solve(PHASES) if laws.crank else model.solve(t=laws.duration * PHASES / (2.0 * np.pi))
    return list(frames(model.mechanism, motion, SMALL, paths="whole"))


def write(name: str, pictures: list[Picture]) -> None:
    """Write an animation that repeats."""
    first, *others = (Image.fromarray(picture).quantize(96) for picture in pictures)
    first.save(FOLDER / name, save_all=True, append_images=others, duration=MILLISECONDS, loop=0)


if __name__ == "__main__":
    wrong = replace(gripper("56 mm"), source="short_arm")
    write(
        "gripper.gif",
        list(
            frames(
                ms.load("parallel_gripper").mechanism, gripper("57 mm"), GRIPPER, exact=wrong, paths="whole"
            )
        ),
    )
    write("row.gif", [np.concatenate(row, 1) for row in zip(*map(one_cycle, ROW), strict=True)])
