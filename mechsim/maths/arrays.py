"""The array of the house, and memory that its arrays find again."""

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

# glibc hands memory back to the system after each step of a calculation, to take it page by page again for
# the next, until it has seen an array of some size come and go: else that costs more than the calculation
np.empty(2_000_000)
