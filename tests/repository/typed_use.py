"""A user's script for mypy: the public interface is typed, and a wrong argument is detected."""

from typing import assert_type

import numpy as np

import mechsim as ms

linkage = ms.catalog.make("rssr", crank=0.014)
exact = linkage.solve(np.linspace(0.0, 6.0, 73), speed=ms.units.rpm(3000))
assert_type(exact, ms.Motion)
run = ms.simulate(linkage, speed=ms.units.rpm(3000), turns=2, tolerance=1e-6)
assert_type(run, ms.Run)
verdict = ms.crosscheck(run.motion, exact)
assert_type(verdict.passed, bool)
assert_type(ms.units.parse_length("13 mm"), float)
ms.Look, ms.plots.motion_plot, ms.load_profile.constant, ms.masses.with_inertia, ms.motors
ms.simulate(linkage, speed="600rpm", tolerance="1um")
ms.simulate(linkage, speed=[600])  # type: ignore[arg-type]
ms.nothing  # type: ignore[attr-defined]
