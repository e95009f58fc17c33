"""Model reduction: removal, one by one, of elements of a scene that its tracked points do not need."""

import mechsim.simulation  # loads MuJoCo without a back end that fails  # noqa: F401 # pyright: ignore[reportUnusedImport]
