"""Speed against accuracy, measured: the ladder of settings, the trials, and what they recommend."""

import mechsim.simulation  # loads MuJoCo without a back end that fails  # noqa: F401 # pyright: ignore[reportUnusedImport]
