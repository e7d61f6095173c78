"""Settings that apply to all tests."""

import gc
import os
import signal
import sys
import tempfile

import pytest
from hypothesis import HealthCheck, Phase, settings

# The duration of an example, and of drawing it, depends on the machine more than on the code. Each
# run draws other examples, so a third of the usual number finds as much in three runs.
ANY_DURATION = {"deadline": None, "suppress_health_check": [HealthCheck.too_slow]}
settings.register_profile("minerva", max_examples=30, **ANY_DURATION)
# pytest --hypothesis-profile thorough
settings.register_profile("thorough", max_examples=1000, **ANY_DURATION)
# For mutation testing (tools/mutation.py): the first failure decides; shrinking is unnecessary. As
# many examples as in the usual run, whose tests are judged.
settings.register_profile(
    "mutation",
    max_examples=30,
    derandomize=True,
    database=None,
    phases=(Phase.explicit, Phase.generate),
    **ANY_DURATION,
)
settings.load_profile("minerva")

# Each worker imports all test modules, and jsonschema compiles a grammar of this optional package,
# which takes 2 s; no test checks IRIs.
sys.modules["rfc3987_syntax"] = None

# To import and collect all tests creates millions of objects and almost no garbage.
gc.disable()

pytest_plugins = ["tests.patience", "tests.flaky", "tests.forks", "tests.quick", "tests.starts"]


def pytest_configure(config):
    """Enable Ctrl-C for the worlds of tests.

    A shell that starts pytest in the background makes it ignore SIGINT, and its children inherit
    that.
    """
    if signal.getsignal(signal.SIGINT) is signal.SIG_IGN:
        signal.signal(signal.SIGINT, signal.default_int_handler)


@pytest.hookimpl(tryfirst=True)
def pytest_runtestloop():
    """Let no garbage collection go through the imported modules and the collected tests.

    With the usual threshold of 700 objects, simulated worlds spend a seventh of their time in it.
    """
    gc.freeze()
    gc.set_threshold(10_000)
    gc.enable()


@pytest.fixture(scope="session", autouse=True)
def folder_of_worlds():
    """The folder of the worlds that run in this test process.

    A world excludes others of its name for this user: those of other test processes, too.
    """
    with tempfile.TemporaryDirectory(prefix="minerva-tests-", ignore_cleanup_errors=True) as folder:
        os.environ["MINERVA_RUNTIME_DIR"] = folder
        yield


@pytest.fixture(scope="module", autouse=True)
def environment(folder_of_worlds):
    """The environment of a test file is not that of the next one: Dask sets PYTHONHASHSEED."""
    before = dict(os.environ)
    yield
    for key in os.environ.keys() - before.keys() - {"PYTEST_CURRENT_TEST"}:
        del os.environ[key]
    os.environ.update(before)


ON_DEMAND = {
    "slow": "takes minutes; run it with pytest -m slow",
    "deploy": "makes machines and containers, as root; run it with pytest -m deploy",
}
"""Markers of tests that run on demand only, with the reason shown when skipped."""


def pytest_collection_modifyitems(config, items):
    """Skip on-demand tests unless their marker is requested."""
    for marker, reason in ON_DEMAND.items():
        if marker not in config.getoption("markexpr"):
            for item in items:
                if item.get_closest_marker(marker):
                    item.add_marker(pytest.mark.skip(reason=reason))
