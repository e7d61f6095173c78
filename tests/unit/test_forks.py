"""`pytest --forks`: each test runs once and is reported as without the option, whatever it does."""

from pathlib import Path

import pytest

from tests.patience import eventually

pytest_plugins = ["pytester"]

ROOT = Path(__file__).parents[2]
OUTCOMES = """
import sys, warnings
import pytest
open("imported", "a").write("once ")
LOG = sys.stderr

def test_passes(tmp_path):
    assert tmp_path.is_dir()

def test_warns():
    warnings.warn("a strange wind")

def test_skips():
    pytest.skip("no sea here")

def test_fails():
    print("heard")
    print("seen", file=LOG)
    assert {"depth": 1} == {"depth": 2}

@pytest.fixture(scope="module")
def harbour():
    yield
    raise ValueError("flooded")

def test_errs(harbour):
    pass
"""
ENDINGS = """
import os, signal, time
import pytest

def test_first():
    pass

def test_dies():
    os.kill(os.getpid(), signal.SIGKILL)

def test_second():
    pass

@pytest.mark.timeout(0.5)
def test_hangs():
    signal.pthread_sigmask(signal.SIG_BLOCK, [signal.SIGALRM])
    while True:
        time.sleep(1)

def test_last(tmp_path):
    assert tmp_path.is_dir()
"""
STOPPED = """
import time
from pathlib import Path
import pytest

@pytest.fixture(scope="session")
def harbour():
    Path("opened").touch()
    yield
    Path("closed").touch()

def test_waits(harbour):
    time.sleep(60)
"""
STOPPING = """
import time
from pathlib import Path

def test_fails():
    while not Path("opened").exists():
        time.sleep(0.01)
    assert 0
"""
FINE = "def test_fine():\n    pass\n"
THIEF = """
import os
from pathlib import Path

def test_passes_if_run_again():
    again = Path("again").exists()
    Path("again").touch()
    assert again

def test_takes_a_file_from_the_queue(request):
    assert os.read(request.config.pluginmanager.get_plugin("fork").queue, 4)
"""
MEETING = """
import time
from pathlib import Path
import pytest

APART = True

@pytest.mark.parametrize(("own", "other"), [("a", "b"), ("b", "a")])
def test_meets_the_other(own, other):
    Path(own).touch()
    while not Path(other).exists():
        time.sleep(0.01)
"""
ABANDONED = """
import os, signal, subprocess, sys
from pathlib import Path

def test_waits_without_end():
    Path("wait.py").write_text("import signal; signal.pause()")
    child = subprocess.Popen([sys.executable, "wait.py"])
    Path("processes").write_text(f"{os.getpid()} {child.pid}")
    os.kill(os.getppid(), signal.SIGKILL)
    child.wait()
"""
LIMITED = """
import pytest

{}
def test_is_noted():
    open("order", "a").write("{} ")
"""


@pytest.fixture
def suite(pytester, monkeypatch):
    """Run pytest with two forks on test files in a separate process."""
    monkeypatch.setenv("PYTHONPATH", str(ROOT))
    monkeypatch.setenv("PYTEST_DISABLE_PLUGIN_AUTOLOAD", "1")
    monkeypatch.delenv("PYTEST_ADDOPTS", raising=False)
    pytester.makeconftest('pytest_plugins = ["tests.patience", "tests.forks"]')

    def run(*options, before="", **files):
        if before:
            pytester.makeconftest(f'{before}\npytest_plugins = ["tests.patience", "tests.forks"]')
        pytester.makepyfile(**{f"test_{name}": text for name, text in files.items()})
        return pytester.runpytest_subprocess("-p", "pytest_timeout", "--forks", "2", *options)

    return run


def test_each_outcome_is_reported_as_without_forks(suite):
    more = {f"good_{n}": FINE for n in range(4)}
    result = suite("-q", "-rs", outcomes=OUTCOMES, **more)
    result.assert_outcomes(passed=7, failed=1, skipped=1, errors=1, warnings=1)
    assert Path("imported").read_text() == "once "
    result.stdout.fnmatch_lines_random(
        [
            "*ERROR at teardown of test_errs*", "E       ValueError: flooded",
            "E*Differing items:", "heard", "seen", "*UserWarning: a strange wind",
            "SKIPPED [[]1[]] test_outcomes.py:13: no sea here",
        ]
    )  # fmt: skip


def test_the_tests_after_one_that_ends_its_process_run(suite):
    result = suite(endings=ENDINGS)
    result.assert_outcomes(passed=3, failed=2)
    result.stdout.fnmatch_lines(
        [
            "*_ test_dies _*", "the process has ended with -9 after 0 s of this test",
            "*_ test_hangs _*", "the process has ended with -9 after * s of this test",
        ]
    )  # fmt: skip


def test_a_run_that_stops_finishes_the_fixtures_of_other_forks(suite):
    result = suite("-x", stopped=STOPPED, stopping=STOPPING)
    result.assert_outcomes(failed=1)
    assert Path("closed").exists()


def test_nothing_outlives_a_run_that_is_killed(suite):
    suite("-p", "tests.starts", abandoned=ABANDONED)
    processes = Path("processes").read_text().split()
    eventually(lambda: not any(map(runs, processes)), processes)


def runs(process):
    """Whether a process has not ended, also if nobody has asked for its exit code."""
    stat = Path("/proc", process, "stat")
    return stat.exists() and stat.read_text().rpartition(") ")[2][0] != "Z"


def test_files_with_higher_limits_come_first(suite):
    marks = {
        "a": "", "b": "@pytest.mark.timeout(300)",
        "c": "@pytest.mark.timeout(900)\n@pytest.mark.skip", "d": "@pytest.mark.timeout(600)",
    }  # fmt: skip
    files = {name: LIMITED.format(mark, name) for name, mark in marks.items()}
    suite("--forks", "1", "-o", "timeout=120", **files).assert_outcomes(passed=3, skipped=1)
    assert Path("order").read_text() == "d b a "


def test_tests_that_are_apart_run_in_several_forks(suite):
    suite(meeting=MEETING).assert_outcomes(passed=2)


def test_a_test_that_did_not_run_is_an_error(suite):
    more = ("-p", "tests.flaky", "--retry")
    result = suite("--forks", "1", *more, a_thief=THIEF, lost=FINE, other=FINE)
    result.stdout.fnmatch_lines("*! 1 of 4 tests did not run !*")
    result.assert_outcomes(passed=2, failed=1)
    assert result.ret == pytest.ExitCode.TESTS_FAILED


def test_a_system_without_process_descriptors_runs_the_tests_in_one_process(suite):
    result = suite(before="import os\ndel os.pidfd_open", fine=FINE)
    result.stdout.fnmatch_lines("*--forks needs Linux 5.3: the tests run in this process")
    assert result.ret == pytest.ExitCode.OK
