"""A whole turn."""

import numpy as np

TURN = 2.0 * np.pi  # in [rad]
