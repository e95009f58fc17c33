"""Model reduction: elements of a scene that its tracked points do not need, removed one after the other."""

import mechsim.simulation  # loads MuJoCo without a back end that fails  # noqa: F401 # pyright: ignore[reportUnusedImport]
