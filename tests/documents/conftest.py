"""The network in which the documentation's commands run."""

import pytest
from terminal import Island


@pytest.fixture(scope="session")  # Two fork servers start in each, with 1.3 s of CPU time each.
def island(request, tmp_path_factory):
    island = Island(tmp_path_factory.mktemp("island"))
    yield island
    if (starts := request.config.pluginmanager.get_plugin("starts")) and island.inside:
        starts.close(tuple(island.inside))
    island.close()
