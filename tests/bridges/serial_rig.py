"""Cables that can be pulled and plugged in again."""

import os
import pty
import select
import threading
import time
import tty
from contextlib import suppress


class Cable:
    """A serial line at a path: `device` is its other end, plugged in until it is pulled."""

    def __init__(self, path):
        self.path = path
        self.plugged = False
        self._lock = threading.RLock()

    def plug(self):
        self.master, self._slave = pty.openpty()
        tty.setraw(self._slave)
        os.set_blocking(self.master, False)
        self.path.unlink(missing_ok=True)
        self.path.symlink_to(os.ttyname(self._slave))
        self.plugged = True
        return self

    def pull(self):
        with self._lock:
            if self.plugged:
                self.plugged = False
                self.path.unlink()
                os.close(self.master)
                os.close(self._slave)

    def read(self):
        """What was sent to the device, maybe nothing."""
        with self._lock:
            if not self.plugged or not select.select([self.master], [], [], 0)[0]:
                return b""
            with suppress(OSError):
                return os.read(self.master, 4096)
            return b""

    def write(self, data):
        """Let the device send as fast as its data are read; return whether all of them were.

        The rest is lost where the other end says something instead of listening.
        """
        while data:
            with self._lock:
                if not self.plugged:
                    return False
                try:
                    data = data[os.write(self.master, data) :]
                except BlockingIOError:
                    if select.select([self.master], [], [], 0)[0]:
                        return False
                except OSError:
                    return False
            if data:
                time.sleep(0.001)
        return True

    def __enter__(self):
        return self.plug()

    def __exit__(self, *exc):
        self.pull()
