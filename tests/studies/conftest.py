"""The finger under control and under a drive, for the tests of scenes."""

import pytest
from scene_texts import CONTROL, DRIVEN, scene


@pytest.fixture(scope="session")
def controlled(tmp_path_factory):
    return scene(tmp_path_factory.mktemp("controlled"), ctrl=CONTROL)


@pytest.fixture(scope="session")
def driven(tmp_path_factory):
    return scene(tmp_path_factory.mktemp("driven"), drive=DRIVEN)
