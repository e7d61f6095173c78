"""`--retry`: run each failed test once more, alone, after all others have finished.

A test that then passes is flaky: the run succeeds, and its last lines name the test. "Alone" means
in a separate process, one test at a time, when no fork has tests left to run.
A test that fails on an example of Hypothesis fails again, because Hypothesis stores the example.
"""

import argparse
import contextlib
import os
import signal
import subprocess
import sys
import tempfile

import pytest

from tests.patience import patience

MOST = 10
"""Maximum number of retried tests. More failures point to the change, not to single tests. Tests
that a limit of time has ended are retried in addition: they point to the load of the machine."""
LONGEST = 1200
"""Limit of a retried test, seconds of an idle machine. Each test has a limit of its own, which ends
no process that the test has started."""


def pytest_addoption(parser):
    parser.getgroup("general").addoption(
        "--retry",
        action=argparse.BooleanOptionalAction,
        default=False,
        help="run each failed test once more, alone, at the end; if it passes, the run succeeds "
        "and its last lines name the test as flaky",
    )


def pytest_configure(config):
    if config.getoption("retry") and not hasattr(config, "workerinput"):
        config.pluginmanager.register(Retry(config))


class Retry:
    """The failed tests of a session, and those of them that pass alone."""

    def __init__(self, config):
        self.config = config
        self.failed = {}
        self.flaky = []

    @property
    def terminal(self):
        return self.config.pluginmanager.get_plugin("terminalreporter")

    def pytest_runtest_logreport(self, report):
        if report.failed:
            self.failed.setdefault(report.nodeid, []).append(report)

    @pytest.hookimpl(wrapper=True, tryfirst=True)
    def pytest_sessionfinish(self, session, exitstatus):
        ended = exitstatus == pytest.ExitCode.TESTS_FAILED
        if ended and self.failed and not (session.shouldfail or session.shouldstop):
            self.retry(session)
        result = yield
        for nodeid in self.flaky:
            self.terminal.write_line(f"FLAKY {nodeid} (failed, then passed alone)", yellow=True)
        return result

    def retry(self, session):
        """Rerun the failed tests and clear the failures of those that pass."""
        self.terminal.line("")
        late = {nodeid for nodeid, reports in self.failed.items() if any(map(is_late, reports))}
        again, others = self.failed, len(self.failed) - len(late)
        if others > MOST:
            self.terminal.write_line(f"{others} failed; not run again (at most {MOST})")
            again = {nodeid: self.failed[nodeid] for nodeid in late}
        for nodeid, reports in again.items():
            self.terminal.write(f"alone: {nodeid} ", flush=True)
            passed = self.passes_alone(nodeid)
            self.terminal.write_line("passed" if passed else "failed again")
            if passed:
                self.flaky.append(nodeid)
                session.testsfailed -= len(reports)
        self.correct_counts()
        if not session.testsfailed:
            session.exitstatus = pytest.ExitCode.OK

    def passes_alone(self, nodeid):
        """Whether the test passes in a separate process; skipped does not count."""
        command = [sys.executable, "-m", "pytest", "-q", "--color=no", "--no-retry"]
        for plugin in self.config.getoption("plugins"):
            command += ["-p", plugin]
        command += ["-m", self.config.getoption("markexpr"), nodeid]
        # A file, not a pipe: a process that outlives the test keeps the pipe open, and reading it
        # would wait for that process.
        with tempfile.TemporaryFile("w+") as output:
            process = subprocess.Popen(
                command,
                cwd=self.config.rootpath,
                stdin=subprocess.DEVNULL,
                stdout=output,
                stderr=subprocess.STDOUT,
                start_new_session=True,
            )
            try:
                code = process.wait(patience(LONGEST))
            except subprocess.TimeoutExpired:
                code = None
            finally:
                end_group(process)
            output.seek(0)
            return code == 0 and "\n1 passed" in output.read()

    def correct_counts(self):
        """Count flaky tests as flaky in the summary, not as failures or errors."""
        stats = self.terminal.stats
        for kind in ("failed", "error"):
            kept = [report for report in stats.pop(kind, []) if report.nodeid not in self.flaky]
            if kept:
                stats[kind] = kept
        if self.flaky:
            stats["flaky"] = [self.failed[nodeid][0] for nodeid in self.flaky]

    def pytest_terminal_summary(self, terminalreporter):
        """Print the output of flaky tests."""
        if not self.flaky:
            return
        terminalreporter.section("FLAKY: failed, then passed alone")
        for nodeid in self.flaky:
            for report in self.failed[nodeid]:
                terminalreporter.section(nodeid, "_")
                terminalreporter.write_line(report.longreprtext)
                for title, text in report.sections:
                    terminalreporter.section(title, "-")
                    terminalreporter.write_line(text)


def is_late(report):
    """Whether a limit of time has ended the test (see tests/patience.py)."""
    return getattr(report, "late", False)


def end_group(process):
    """Kill what is left of a process and of its group."""
    with contextlib.suppress(ProcessLookupError):
        os.killpg(process.pid, signal.SIGKILL)
    process.wait()
