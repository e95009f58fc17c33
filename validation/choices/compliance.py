"""What of a place error is compliance and what is rounding: which way a compliance is changed.

A five-bar under its weight, its cranks swinging once in 1 s, 100 s and 10,000 s, and a Bennett linkage, whose
rows repeat each other, without weight at 600 rpm; 1,000 steps. Reference: the poses solved at the drivers'
own places, to 1e-16 m. Errors are the worst distance of a tracked point in m. Newton's method finds
accelerations; MuJoCo's noslip pass, which a run leaves out, takes them from forces, with all their rounding.

The error is proportional to compliance: the script exits with 1 where a hundredth of the compliance does not
leave a hundredth of the error, within 5 %, of the slow five-bar.

Run: python validation/choices/compliance.py
"""

import sys
import tempfile
from pathlib import Path
from unittest import mock

import numpy as np
import study_table as sheet

from mechsim import catalog
from mechsim.io.readers import load
from mechsim.mechanism.motion_laws import constant
from mechsim.simulation import Settings, simulate
from mechsim.simulation.mjcf.compiling import quiet

FIVE_BAR = """<mujoco model="five-bar"><option gravity="0 -9.81 0"/><default><joint axis="0 0 1"/></default>
<worldbody>
<body pos="-.031 0 0"><joint name="left"/><geom size=".012"/>
 <body pos="-.02 .06 0"><joint/><geom pos=".03 .02 0" size=".005"/>
  <site name="P" pos=".055 .04 0"/></body></body>
<body pos=".037 .004 0"><joint name="right"/><geom size=".012"/>
 <body pos=".023 .056 0"><joint/><geom pos="-.02 .02 0" size=".005"/>
  <site name="Q" pos="-.056 .04 0"/></body></body>
</worldbody><equality><connect site1="P" site2="Q"/></equality></mujoco>"""
COMPLIANCES = (1e-2, 1e-4, 1e-6, 1e-8, 1e-10, 1e-12, 1e-14)
PERIODS = (1.0, 100.0, 10_000.0)
STEPS, SPEED = 1000, 20.0 * np.pi
APPLY = Settings.apply


def with_noslip(settings, loops, timestep, **options):
    """Set up a compiled model as `Settings.apply` does, but for the noslip pass."""
    used = APPLY(settings, loops, timestep, **options)
    loops.model.opt.noslip_iterations = 1
    return used


def errors(moved):
    """Return the worst place error of runs by each compliance, in [m]."""
    return [moved(Settings(steps_per_turn=STEPS, compliance=item)).estimate for item in COMPLIANCES]


def five_bar(period, path):
    swing = f"*sin(2*pi*t/{period:.0f})"
    solver = load(str(path), drive={"left": f"0.11{swing}", "right": f"0.13{swing}"}, duration=period)
    return lambda settings: simulate(solver, settings=settings)


@quiet()
def main() -> None:
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "five_bar.xml"
        path.write_text(FIVE_BAR)
        cases = {f"five-bar, {period:g} s": five_bar(period, path) for period in PERIODS}
    bennett = catalog.make("bennett")
    cases["bennett"] = lambda settings: simulate(bennett, profile=constant(SPEED, 1.0), settings=settings)
    result = {name: errors(moved) for name, moved in cases.items()}
    slow = np.array(result["five-bar, 100 s"])
    with mock.patch.object(Settings, "apply", with_noslip):
        result |= {f"{name}, noslip": errors(moved) for name, moved in cases.items()}
    rows = [
        {"motion": name, **{f"{item:.0e}": error for item, error in zip(COMPLIANCES, each, strict=True)}}
        for name, each in result.items()
    ]
    sheet.show(rows)
    falls = slow[1:4] / slow[2:5]
    sys.exit(0 if (np.abs(falls / 100.0 - 1.0) < 0.05).all() else 1)


if __name__ == "__main__":
    main()
