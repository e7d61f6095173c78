"""`--forks N`: collect the tests once, then run their files in N forks of this process.

Each worker of pytest-xdist imports and collects all tests by itself, which takes six workers longer
than a minute of CPU time. The forks take one file after the other, in order. When a fork ends early,
or runs a test for twice its limit, that test fails and another fork runs the following ones.
"""

import json
import os
import random
import selectors
import signal
import sys
import time
import traceback
import warnings
from collections import deque
from itertools import chain, groupby, pairwise
from tempfile import TemporaryFile
from types import SimpleNamespace

import pytest
from _pytest.capture import FDCapture
from _pytest.config import create_terminal_writer

WIDTH = 4
"""Bytes of the number of a file in the queue."""
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
        config.pluginmanager.register(Forks(), "forks")


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
        self.files = [list(items) for _, items in groupby(session.items, lambda item: item.path)]
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
        finally:
            os.close(queue)
            for fork in self.forks:
                fork.stop()
        missed = len(session.items) - sum(fork.done for fork in self.forks)
        if missed:
            raise session.Failed(f"{missed} of {len(session.items)} tests did not run")
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
        self.finished = self.ended = False
        self.reader, writer = os.pipe()
        sys.stdout.flush()
        sys.stderr.flush()
        self.pid = os.fork()
        if not self.pid:
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
        marker = self.item.get_closest_marker("timeout")
        limit = marker.args[0] if marker else getattr(self.config, "_env_timeout", None)
        if limit and time.monotonic() > self.since + LONGEST * limit:
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
            if not selector.select(GOODBYE):
                os.kill(self.pid, signal.SIGKILL)
        self.wait()

    def wait(self):
        """Wait for the end of the process; returns its exit code."""
        code = os.waitstatus_to_exitcode(os.waitpid(self.pid, 0)[1])
        os.close(self.process)
        os.close(self.reader)
        self.ended = True
        return code


def place(item):
    return {"nodeid": item.nodeid, "location": item.location}


class Work:
    """What a fork does: it runs tests and reports them through a pipe."""

    def __init__(self, session, files, queue, writer):
        self.session, self.config = session, session.config
        self.files, self.queue, self.writer = files, queue, writer
        self.begun = False

    def run(self, first):
        """Run these tests and those of the queue; returns the exit code."""
        try:
            self.separate()
            for items in chain([[*first]], self.queued()):
                # After the last test of a file, only what belongs to the session stays.
                for item, following in pairwise([*items, self.session]):
                    self.config.hook.pytest_runtest_protocol(item=item, nextitem=following)
            self.end()
            self.tell("finished")
        except KeyboardInterrupt:
            self.end()
        except BaseException:
            traceback.print_exc(file=sys.__stderr__)
            raise
        return 0

    def end(self):
        self.session._setupstate.teardown_exact(None)
        self.config._ensure_unconfigure()

    def separate(self):
        """Renew what two processes cannot share: output, folders and random numbers."""
        plugins = self.config.pluginmanager
        plugins.unregister(name="forks")
        plugins.unregister(name="terminalreporter")
        # pytest-timeout prints the stacks of threads.
        terminal = create_terminal_writer(self.config, sys.__stderr__)
        plugins.register(SimpleNamespace(_tw=terminal), "terminalreporter")
        plugins.register(self, "fork")
        capturing = plugins.getplugin("capturemanager")._global_capturing
        for capture in (capturing.out, capturing.err):
            # Imported modules keep `sys.stderr`, so it stays open: its file becomes another.
            if isinstance(capture, FDCapture):
                with TemporaryFile() as file:
                    os.dup2(file.fileno(), capture.tmpfile.fileno(), inheritable=False)
        folders = self.config._tmp_path_factory
        folders._basetemp = folders.getbasetemp() / str(os.getpid())
        folders._basetemp.mkdir(0o700)
        random.seed()

    def queued(self):
        """The tests of the files that this fork takes from the queue."""
        while number := os.read(self.queue, WIDTH):
            file = int.from_bytes(number, "big")
            self.tell("file", file)
            yield self.files[file]

    def tell(self, kind, *values):
        text = json.dumps([kind, *values], default=str).encode() + b"\n"
        while text:
            text = text[os.write(self.writer, text) :]

    def pytest_runtest_logstart(self):
        self.begun = True
        self.tell("begin")

    def pytest_runtest_logreport(self, report):
        data = self.config.hook.pytest_report_to_serializable(config=self.config, report=report)
        self.tell("report", data)

    def pytest_runtest_logfinish(self):
        self.tell("end")

    def pytest_warning_recorded(self, warning_message, when, nodeid):
        # A new plugin gets all earlier warnings, too.
        if self.begun and when == "runtest":
            text, category = str(warning_message.message), warning_message.category.__name__
            place = warning_message.filename, warning_message.lineno
            self.tell("warning", text, category, *place, nodeid)
