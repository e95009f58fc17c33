"""Stepped runs with ball joints: before MuJoCo 4.0 RK4 has second order for them."""

import mujoco
import pytest

fourth_order_only = pytest.mark.skipif(
    int(mujoco.__version__.partition(".")[0]) < 4,
    reason="before MuJoCo 4.0 RK4 has second order for ball joints",
)
