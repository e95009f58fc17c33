"""Speed against accuracy, measured: the settings, the trials, and the recommendations."""

import mechsim.simulation  # loads MuJoCo without a back end that fails  # noqa: F401 # pyright: ignore[reportUnusedImport]
