"""Measured speed against accuracy: settings, trials, and recommendations."""

import mechsim.simulation  # loads MuJoCo without a back end that fails  # noqa: F401 # pyright: ignore[reportUnusedImport]
