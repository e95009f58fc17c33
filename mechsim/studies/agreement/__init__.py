"""A model held against a user's own formula or table: whether they agree, and why not."""

import mechsim.simulation  # loads MuJoCo without a back end that fails  # noqa: F401 # pyright: ignore[reportUnusedImport]
