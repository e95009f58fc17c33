"""The array of the house."""

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
