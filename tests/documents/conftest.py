"""The network in which the documentation's commands run."""

import pytest
from terminal import Island


@pytest.fixture(scope="session")
def island(tmp_path_factory):
    island = Island(tmp_path_factory.mktemp("island"))
    yield island
    island.close()
