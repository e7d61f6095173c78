"""One record for all tests of data sets."""

import pytest

pytest.importorskip("mcap", reason="pip install 'minerva-bus[record]'")
pytest.importorskip("PIL")
from tests.services.rover_yard import record_yard


@pytest.fixture(scope="session")
def recorded(tmp_path_factory):
    """The run of the yard, and its record."""
    path = tmp_path_factory.mktemp("yard") / "yard.mcap"
    return record_yard(path), path
