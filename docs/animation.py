"""Draw docs/gripper.gif: the gallery's parallel gripper in MuJoCo, its exact solution as a dark ghost.

Run: python docs/animation.py
"""

import subprocess
from pathlib import Path

TARGET = Path(__file__).with_name("gripper.gif")
COMMAND = [
    *("mechsim", "render", "parallel_gripper", "--from", "both"),
    *("--drive", "right=57deg-25deg*cos(2*pi*t)", "--duration", "1s"),
    *("--size", "480x360", "--fps", "24", "--no-labels", "-o", str(TARGET)),
]

if __name__ == "__main__":
    subprocess.run(COMMAND, check=True)
