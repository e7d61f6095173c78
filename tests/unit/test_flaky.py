"""`pytest --retry`: tests that fail once and pass alone are flaky; other failures stay."""

from pathlib import Path

import pytest

pytest_plugins = ["pytester"]

ROOT = Path(__file__).parents[2]

WORKERS = ("--forks", "2")
FLAKY = """
from pathlib import Path

def test_flaky():
    before = Path(__file__).with_suffix(".ran")
    if not before.exists():
        before.touch()
        print("heard too late")
        assert False, "the first time"
"""
FIXED = "def test_good():\n    pass\n"
BROKEN = "def test_broken():\n    assert 1 == 2\n"


@pytest.fixture
def suite(pytester, monkeypatch):
    """Run pytest on test files in a separate process."""
    monkeypatch.setenv("PYTHONPATH", str(ROOT))
    monkeypatch.setenv("PYTEST_DISABLE_PLUGIN_AUTOLOAD", "1")
    monkeypatch.delenv("PYTEST_ADDOPTS", raising=False)
    plugins = 'pytest_plugins = ["tests.patience", "tests.flaky", "tests.forks"]'
    pytester.makeconftest(plugins)

    def run(*options, before="", **files):
        if before:
            pytester.makeconftest(f"{before}\n{plugins}")
        pytester.makepyfile(**{f"test_{name}": text for name, text in files.items()})
        return pytester.runpytest_subprocess("-q", *options)

    return run


def last_lines(result):
    return [line for line in result.outlines if line][-2:]


@pytest.mark.parametrize("workers", [(), WORKERS], ids=["one", "forks"])
def test_a_test_that_passes_alone_is_listed_last_and_the_run_is_green(suite, workers):
    result = suite("--retry", *workers, flaky=FLAKY, good=FIXED)
    assert result.ret == 0
    counts, last = last_lines(result)
    assert last == "FLAKY test_flaky.py::test_flaky (failed, then passed alone)"
    assert counts.startswith("1 passed, 1 flaky in ")
    result.stdout.fnmatch_lines(["*the first time*", "heard too late"])


def test_without_the_option_it_fails(suite):
    assert suite(flaky=FLAKY, good=FIXED).ret == 1


def test_a_test_that_fails_again_fails_the_run_that_names_the_flaky_one_too(suite):
    result = suite("--retry", *WORKERS, flaky=FLAKY, broken=BROKEN)
    assert result.ret == 1
    counts, last = last_lines(result)
    assert counts.startswith("1 failed, 1 flaky in ")
    assert "test_flaky.py::test_flaky" in last
    result.stdout.fnmatch_lines(
        ["*alone: test_broken.py::test_broken failed again", "FAILED test_broken*"]
    )


def test_it_runs_after_all_others_and_beside_none(suite):
    """The test fails while another one runs, and passes after that has ended."""
    meeting = """
import time
from pathlib import Path
running, ended = Path("running"), Path("ended")
"""
    long = (
        meeting
        + """
def test_long():
    running.touch()
    while not Path("failed").exists():
        time.sleep(0.01)
    time.sleep(0.5)
    ended.touch()
"""
    )
    lonely = (
        meeting
        + """
def test_lonely():
    while not running.exists():
        time.sleep(0.01)
    Path("failed").touch()
    assert ended.exists()
"""
    )
    result = suite("--retry", *WORKERS, long=long, lonely=lonely)
    assert result.ret == 0
    assert "test_lonely" in last_lines(result)[1]


def test_failing_fixtures_and_dying_workers_are_retried(suite):
    fixture = FLAKY.replace("def test_flaky", "import pytest\n@pytest.fixture\ndef it") + (
        "\n    yield\ndef test_uses(it):\n    pass\n"
    )
    dying = FLAKY.replace('assert False, "the first time"', "import os; os._exit(3)")
    result = suite("--retry", *WORKERS, fixture=fixture, dying=dying)
    assert result.ret == 0
    assert {"test_fixture.py::test_uses", "test_dying.py::test_flaky"} == {
        line.split()[1] for line in last_lines(result)
    }


def test_a_test_that_is_skipped_the_second_time_has_not_passed(suite):
    text = FLAKY + "    else:\n        import pytest\n        pytest.skip('not now')\n"
    assert suite("--retry", skipping=text).ret == 1


def test_a_process_that_outlives_its_test_does_not_hold_up_the_run(suite, pytester):
    text = FLAKY + (
        "    else:\n"
        "        import os, subprocess\n"
        "        before.write_text(str(subprocess.Popen(['sleep', '600']).pid))\n"
        "        os._exit(1)\n"
    )
    result = suite("--retry", leaving=text)
    assert result.ret == 1
    result.stdout.fnmatch_lines(["*alone: test_leaving.py::test_flaky failed again"])
    status = Path("/proc", (pytester.path / "test_leaving.ran").read_text(), "stat")
    assert not status.exists() or status.read_text().split()[2] == "Z"


def test_files_that_cannot_be_read_are_errors(suite):
    assert suite("--retry", flaky=FLAKY, unreadable="import nothing_of_this_name\n").ret != 0
    result = suite(
        "--retry", "--continue-on-collection-errors", flaky=FLAKY.replace(".ran", ".again")
    )
    assert result.ret == 1


def test_a_law_that_an_example_breaks_is_not_flaky(suite):
    law = """
from hypothesis import given, strategies as st

@given(st.integers())
def test_law(x):
    assert x != 100
"""
    unlucky = law.replace("x != 100", "x < 5_000")
    assert suite("--retry", law=unlucky).ret == 1


def test_many_failures_are_not_run_again(suite):
    module_text = (
        "import pytest\n@pytest.mark.parametrize('x', range(11))\ndef test_x(x):\n    assert 0\n"
    )
    result = suite("--retry", many=module_text)
    assert result.ret == 1
    result.stdout.fnmatch_lines(["11 failed; not run again (at most 10)"])


def test_what_a_limit_of_time_has_ended_is_always_run_again(suite):
    texts = {
        "waiting": "import subprocess; subprocess.run(['sleep', '60'], timeout=0.1)",
        "eventually": "from tests.patience import eventually; eventually(lambda: 0, seconds=0.1)",
        "limit": "import time; time.sleep(60)",
    }
    late = {
        name: FLAKY.replace('assert False, "the first time"', text) for name, text in texts.items()
    }
    late["limit"] = late["limit"].replace("def ", "import pytest\n@pytest.mark.timeout(0.5)\ndef ")
    result = suite(
        "--retry", *WORKERS, "-p", "pytest_timeout",
        before="import tests.flaky\ntests.flaky.MOST = 0", broken=BROKEN, **late,
    )  # fmt: skip
    assert result.ret == 1
    result.stdout.fnmatch_lines("1 failed; not run again (at most 0)")
    result.stdout.fnmatch_lines("1 failed, *3 flaky in *")


def test_chosen_markers_choose_again(suite):
    text = FLAKY.replace("def test_flaky", "import pytest\n@pytest.mark.slow\ndef test_flaky")
    assert suite("--retry", "-m", "slow", "-W", "ignore", good=FIXED, marked=text).ret == 0


def test_an_option_for_all_runs_does_not_retry_forever(suite, monkeypatch):
    monkeypatch.setenv("PYTEST_ADDOPTS", "--retry")
    assert suite(broken=BROKEN).ret == 1
