"""What a fork of `tests/forks.py` does: it runs tests and reports them to the process that collected them."""

import json
import os
import random
import sys
import traceback
from itertools import chain, pairwise
from tempfile import TemporaryFile
from types import SimpleNamespace

from _pytest.capture import FDCapture
from _pytest.config import create_terminal_writer

WIDTH = 4
"""Bytes of the number of a file in the queue."""


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
