"""Comparison of a model with a formula or a table, and the cause of a difference."""

import mechsim.simulation  # loads MuJoCo without a back end that fails  # noqa: F401 # pyright: ignore[reportUnusedImport]
