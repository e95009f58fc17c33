"""Custom MJCF scenes in plain MuJoCo: motion, runs, exact closure, errors, cost, tuned settings."""

import mechsim.simulation  # loads MuJoCo without a back end that fails  # noqa: F401 # pyright: ignore[reportUnusedImport]
