"""What a scene does not need for what is tracked of it: tried alone and together, the whole judged."""

import mechsim.simulation  # loads MuJoCo without a back end that fails  # noqa: F401 # pyright: ignore[reportUnusedImport]
from mechsim.studies.reduction.bench import LeanErrors
from mechsim.studies.reduction.search import By, LeftOut, Reduction, reduced
from mechsim.studies.reduction.told import with_comment

__all__ = ["By", "LeanErrors", "LeftOut", "Reduction", "reduced", "with_comment"]
