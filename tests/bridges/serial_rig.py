"""Serial cables that can be unplugged and plugged in again."""

import os
import pty
import select
import threading
import time
import tty
from contextlib import suppress


class Cable:
    """A serial line at a path; `device` is its other end, connected until it is pulled."""

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
        """Bytes that were sent to the device, possibly none."""
        with self._lock:
            if not self.plugged or not select.select([self.master], [], [], 0)[0]:
                return b""
            with suppress(OSError):
                return os.read(self.master, 4096)
            return b""

    def write(self, data):
        """Send as the device, as fast as the other end reads; return whether all data were read.

        The rest is discarded if the other end sends something instead of reading.
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
