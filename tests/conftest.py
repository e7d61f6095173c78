"""What holds for all tests."""

import signal

import pytest
from hypothesis import Phase, settings

# How long an example takes says more about the machine than about the code.
settings.register_profile("minerva", deadline=None)
# For mutation testing (tools/mutation.py): the first failure decides, the smallest does not matter.
settings.register_profile(
    "mutation",
    deadline=None,
    derandomize=True,
    database=None,
    phases=(Phase.explicit, Phase.generate),
)
settings.load_profile("minerva")

pytest_plugins = ["tests.flaky"]


def pytest_configure():
    """Ctrl-C reaches the worlds of tests, also where a shell has begun pytest in its background.

    Such a shell has the signal ignored, and so do all processes that come of it.
    """
    if signal.getsignal(signal.SIGINT) is signal.SIG_IGN:
        signal.signal(signal.SIGINT, signal.default_int_handler)


def pytest_collection_modifyitems(config, items):
    """What takes minutes runs when it is asked for."""
    if "slow" in config.getoption("markexpr"):
        return
    for item in items:
        if item.get_closest_marker("slow"):
            item.add_marker(pytest.mark.skip(reason="takes minutes; run it with pytest -m slow"))
