import pytest
from browser import Browser


@pytest.fixture(scope="session")
def window(tmp_path_factory):
    """Return a browser."""
    with Browser(tmp_path_factory.mktemp("profile")) as browser:
        yield browser
