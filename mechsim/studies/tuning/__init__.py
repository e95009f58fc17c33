"""The cheapest settings with which plain MuJoCo keeps a tolerance on a user's own scene and motion."""

import mechsim.simulation  # loads MuJoCo without a back end that fails  # noqa: F401 # pyright: ignore[reportUnusedImport]
