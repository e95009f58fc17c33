import numpy as np
import pytest

import mechsim as ms


@pytest.fixture(scope="session")
def linkage():
    return ms.catalog.make("rssr")


@pytest.fixture(scope="session")
def motion(linkage):
    return linkage.solve(np.linspace(0.0, 2.0 * np.pi, 37), 60.0)
