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

pytest_plugins = ["tests.flaky", "tests.quick"]


def pytest_configure():
    """Ctrl-C reaches the worlds of tests, also where a shell has begun pytest in its background.

    Such a shell has the signal ignored, and so do all processes that come of it.
    """
    if signal.getsignal(signal.SIGINT) is signal.SIG_IGN:
        signal.signal(signal.SIGINT, signal.default_int_handler)


ON_DEMAND = {
    "slow": "takes minutes; run it with pytest -m slow",
    "deploy": "makes machines and containers, as root; run it with pytest -m deploy",
}
"""Markers of tests that run when they are asked for, and what is said of them otherwise."""


def pytest_collection_modifyitems(config, items):
    """What takes minutes runs when it is asked for."""
    for marker, reason in ON_DEMAND.items():
        if marker not in config.getoption("markexpr"):
            for item in items:
                if item.get_closest_marker(marker):
                    item.add_marker(pytest.mark.skip(reason=reason))
