"""`--forks N`: collect the tests once, then run their files in N forks of this process.

Workers that each import and collect all tests, as pytest-xdist's do, take 11 s of CPU time apiece.
The forks take one file after the other, and one test after the other of a file with `APART = True`.
Files with tests of a higher limit come first, because one of them would still run when the other forks have nothing left to do. When a
fork ends early, or runs a test for twice its limit, that test fails and another fork runs the
following ones.
"""

import json
import os
import selectors
import signal
import sys
import time
import warnings
from collections import deque
from itertools import groupby

import pytest

from tests.fork_server import end_with_parent
from tests.fork_work import WIDTH, Work
from tests.patience import patience

LONGEST = 2.0
"""A fork is killed after this multiple of a test's limit, which did not interrupt the test."""
GOODBYE = 10.0
"""Maximum time in which an interrupted fork finishes its fixtures, seconds."""


def pytest_addoption(parser):
    parser.getgroup("general").addoption(
        "--forks", type=int, default=0, metavar="N",
        help="collect once, then run the test files in N forks of this process",
    )  # fmt: skip


def pytest_configure(config):
    if config.option.forks:
        if hasattr(os, "pidfd_open"):
            config.pluginmanager.register(Forks(), "forks")
        else:
            text = "--forks needs Linux 5.3: the tests run in this process"
            config.issue_config_time_warning(pytest.PytestConfigWarning(text), 2)


class Forks:
    """The forks of a session, and the tests of each file."""

    def __init__(self):
        self.selector = selectors.DefaultSelector()
        self.files = []
        self.forks = []

    def pytest_runtestloop(self, session):
        if session.config.option.collectonly or session.testsfailed:
            return None  # The loop of pytest ends the session.
        # A shell starts background jobs, such as those of .ci/run, with this signal ignored.
        signal.signal(signal.SIGINT, signal.default_int_handler)
        self.files = [list(items) for _, items in groupby(session.items, piece)]
        self.files.sort(key=lambda items: -max(map(limit, items)))
        session.config._tmp_path_factory.getbasetemp()  # The forks make theirs in it.
        queue, writer = os.pipe()
        os.set_blocking(writer, False)  # It holds 16,000 numbers; tests of other files are missed.
        os.write(writer, b"".join(n.to_bytes(WIDTH, "big") for n in range(len(self.files))))
        os.close(writer)
        try:
            for _ in range(min(session.config.option.forks, len(self.files))):
                self.add(session, queue)
            while self.selector.get_map():
                self.turn(session, queue)
            missed = len(session.items) - sum(fork.done for fork in self.forks)
            if missed:
                raise session.Failed(f"{missed} of {len(session.items)} tests did not run")
        except session.Failed as error:
            session.shouldfail = str(error)  # The summary shows it, and nothing is run again.
            raise
        finally:
            os.close(queue)
            for fork in self.forks:
                fork.stop()
        return True

    def add(self, session, queue, first=()):
        fork = Fork(session, self.files, queue, first)
        self.forks.append(fork)
        for file in (fork.reader, fork.process):
            self.selector.register(file, selectors.EVENT_READ, fork)

    def turn(self, session, queue):
        """Handle what forks report, and replace those that ended early."""
        for key, _ in self.selector.select(1.0):
            fork = key.data
            if not fork.ended:
                fork.read()
            if key.fd == fork.process:
                self.selector.unregister(fork.reader)
                self.selector.unregister(fork.process)
                if not fork.bury():
                    self.add(session, queue, fork.waiting)
            if session.shouldfail:
                raise session.Failed(session.shouldfail)
            if session.shouldstop:
                raise session.Interrupted(session.shouldstop)
        for fork in self.forks:
            fork.watch()


class Fork:
    """A fork of this process, as this process sees it; it runs `first` and then files of a queue."""

    def __init__(self, session, files, queue, first):
        self.config, self.hook = session.config, session.config.hook
        self.files = files
        self.waiting = deque(first)
        self.item = None
        self.since = None
        self.done = 0
        self.text = b""
        self.finished = self.ended = self.late = False
        self.reader, writer = os.pipe()
        sys.stdout.flush()
        sys.stderr.flush()
        parent = os.getpid()
        self.pid = os.fork()
        if not self.pid:
            end_with_parent(parent)
            code = 1
            try:
                code = Work(session, files, queue, writer).run(first)
            finally:
                os._exit(code)
        os.close(writer)
        os.set_blocking(self.reader, False)
        self.process = os.pidfd_open(self.pid)

    def read(self):
        """Pass on what the fork has reported."""
        data = b"."
        while data:
            try:
                data = os.read(self.reader, 1 << 16)
            except BlockingIOError:
                break
            self.text += data
        *lines, self.text = self.text.split(b"\n")
        for line in lines:
            self.hear(*json.loads(line))

    def hear(self, kind, *values):
        match kind:
            case "file":
                self.waiting.extend(self.files[values[0]])
            case "begin":
                self.item, self.since = self.waiting.popleft(), time.monotonic()
                self.hook.pytest_runtest_logstart(**place(self.item))
            case "report":
                report = self.hook.pytest_report_from_serializable(
                    config=self.config, data=values[0]
                )
                if report.skipped and isinstance(report.longrepr, list):
                    report.longrepr = tuple(report.longrepr)  # which JSON does not know
                self.hook.pytest_runtest_logreport(report=report)
            case "end":
                self.since, self.done = None, self.done + 1
                self.hook.pytest_runtest_logfinish(**place(self.item))
            case "warning":
                self.warn(*values)
            case "finished":
                self.finished = True

    def warn(self, text, category, path, line, nodeid):
        warning = warnings.WarningMessage(text, type(category, (Warning,), {}), path, line)
        values = {"warning_message": warning, "when": "runtest", "nodeid": nodeid, "location": None}
        self.hook.pytest_warning_recorded.call_historic(kwargs=values)

    def watch(self):
        """Kill the fork if it runs one test much longer than pytest-timeout allows."""
        if self.since is None or self.ended:
            return
        longest = LONGEST * patience(limit(self.item))
        if longest and time.monotonic() > self.since + longest:
            self.late = True
            os.kill(self.pid, signal.SIGKILL)

    def bury(self):
        """Report why the fork has ended; returns whether it has run all of its tests."""
        code = self.wait()
        if self.finished:
            return True
        if self.item is None:
            raise pytest.Session.Failed(f"a fork has ended with {code} before its first test")
        began = self.since is not None
        when = f"after {time.monotonic() - self.since:.0f} s of" if began else "after"
        text = f"the process has ended with {code} {when} this test"
        phase = "call" if began else "teardown"
        report = pytest.TestReport(
            **place(self.item), keywords={}, outcome="failed", longrepr=text, when=phase
        )
        report.late = self.late
        self.hook.pytest_runtest_logreport(report=report)
        if began:
            self.hear("end")
        return False

    def stop(self):
        """Interrupt the fork, so that it finishes its fixtures, and wait for its end."""
        if self.ended:
            return
        os.kill(self.pid, signal.SIGINT)
        with selectors.DefaultSelector() as selector:
            selector.register(self.process, selectors.EVENT_READ)
            if not selector.select(patience(GOODBYE)):
                os.kill(self.pid, signal.SIGKILL)
        self.wait()

    def wait(self):
        """Wait for the end of the process; returns its exit code."""
        code = os.waitstatus_to_exitcode(os.waitpid(self.pid, 0)[1])
        os.close(self.process)
        os.close(self.reader)
        self.ended = True
        return code


def piece(item):
    """What a fork takes at once: the path of a file, or a test of a file whose tests are apart."""
    return item.nodeid if getattr(item.module, "APART", False) else item.path


def limit(item):
    """The limit of a test on an idle machine, seconds; 0: none, or the test is skipped."""
    marker = item.get_closest_marker("timeout")
    if item.get_closest_marker("skip"):
        return 0
    return (marker.args[0] if marker else getattr(item.config, "_env_timeout", None)) or 0


def place(item):
    return {"nodeid": item.nodeid, "location": item.location}
