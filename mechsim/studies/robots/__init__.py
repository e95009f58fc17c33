"""Closed-loop robot models: motor-joint maps, serial twins, servos."""

import mechsim.simulation  # loads MuJoCo without a back end that fails  # noqa: F401 # pyright: ignore[reportUnusedImport]
