"""How long tests wait: all limits are seconds of an idle machine, and slow or loaded machines get more.

A limit ends a test that hangs or that has grown beyond all measure. It does not measure the machine,
so this module multiplies it by how much slower the machine is at present. `pytest.mark.timeout`, the
`timeout` of pyproject.toml and `eventually` do so by themselves. Inside a test of one thread nothing
else needs a limit: that of the test interrupts each call of Python.
"""

import asyncio
import os
import subprocess
import sys
import time
from queue import Empty

import pytest

ROUNDS = 400_000
IDLE = 0.035
"""Seconds that `calibrated` takes on the idle machine for which the limits are."""
DEFAULT = 40.0
"""Limit of `eventually`: a start of a world takes a twentieth."""
CORES = len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


class Late(AssertionError):
    """What a test has waited for did not happen within its limit."""


LATE = (Late, TimeoutError, asyncio.TimeoutError, subprocess.TimeoutExpired, Empty)


def calibrated():
    """How much slower than that machine this one is: by the clock, and by the time of its processor."""
    clock, processor, total = time.perf_counter(), time.process_time(), 0
    for number in range(ROUNDS):
        total += number * number % 7
    return (time.perf_counter() - clock) / IDLE, (time.process_time() - processor) / IDLE


BY_CLOCK, BY_PROCESSOR = calibrated()
PROCESSES = 1
"""Processes that run tests: the load of the last minute does not contain them from the beginning."""


def slowness():
    """How much slower than an idle machine this one is at present; at least 1."""
    load = max(os.getloadavg()[0], PROCESSES) / CORES
    return max(1.0, BY_CLOCK, BY_PROCESSOR * load)


def patience(seconds=DEFAULT):
    """The limit at present, seconds, that is `seconds` on an idle machine."""
    return seconds * slowness()


def eventually(what, why="what is expected", seconds=DEFAULT, pace=0.02):
    """Wait until `what()` is true, and return its value.

    Args:
        what: it is called every `pace` seconds.
        why: what is expected, or a function that returns it.
        seconds: the limit on an idle machine.

    Raises:
        Late: it is not true within the limit.

    """
    began = time.monotonic()
    while not (result := what()):
        if time.monotonic() > began + patience(seconds):
            text = why() if callable(why) else why
            raise Late(f"{text}: not within {time.monotonic() - began:.0f} s")
        time.sleep(pace)
    return result


def is_late(error):
    """Whether an error, or one that led to it, says that a limit of time is over."""
    while error is not None:
        # pytest-timeout has no class of its own, and Playwright another one.
        if isinstance(error, LATE) or type(error).__name__ == "TimeoutError":
            return True
        if str(error).startswith("Timeout (>"):
            return True
        error = error.__cause__ or error.__context__
    return False


def pytest_configure(config):
    global PROCESSES
    PROCESSES = max(1, config.getoption("forks", 0))


@pytest.hookimpl(optionalhook=True, tryfirst=True)
def pytest_timeout_set_timer(item, settings):
    """Give the test its limit on this machine."""
    import pytest_timeout

    limit = settings._replace(timeout=patience(settings.timeout))
    return pytest_timeout.pytest_timeout_set_timer(item, limit)


@pytest.fixture(scope="module", autouse=True)
def patient_bridges():
    """Give the bridges of a test file, which run in threads, their limits on this machine."""
    if testing := sys.modules.get("minerva_services.bridging.testing"):
        testing.TIMEOUT_SECONDS, testing.STOP_TIMEOUT_SECONDS = patience(20), patience(10)


@pytest.hookimpl(wrapper=True)
def pytest_runtest_makereport(item, call):
    """Note in the report that a limit has ended the test (see tests/flaky.py)."""
    report = yield
    report.late = call.excinfo is not None and is_late(call.excinfo.value)
    return report
