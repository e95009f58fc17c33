"""Closed-loop robot models: maps from motors to joints, the serial twin, servos."""

import mechsim.simulation  # loads MuJoCo without a back end that fails  # noqa: F401 # pyright: ignore[reportUnusedImport]
