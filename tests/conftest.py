"""What holds for all tests."""

import pytest
from hypothesis import settings

# How long an example takes says more about the machine than about the code.
settings.register_profile("minerva", deadline=None)
settings.load_profile("minerva")


def pytest_collection_modifyitems(config, items):
    """What takes minutes runs when it is asked for."""
    if "slow" in config.getoption("markexpr"):
        return
    for item in items:
        if item.get_closest_marker("slow"):
            item.add_marker(pytest.mark.skip(reason="takes minutes; run it with pytest -m slow"))
