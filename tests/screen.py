"""A virtual screen with keyboard and mouse, for tests of real windows."""

import ctypes
import os
import shutil
import subprocess

import numpy as np
import pytest
from PIL import ImageGrab

MISSING = [program for program in ("Xvfb", "xdotool") if shutil.which(program) is None]
needs_screen = pytest.mark.skipif(
    bool(MISSING), reason=f"{' and '.join(MISSING)} not installed (apt-get install xvfb xdotool)"
)


class Message(ctypes.Structure):
    """XClientMessageEvent of Xlib."""

    _fields_ = (
        ("type", ctypes.c_int), ("serial", ctypes.c_ulong), ("sent", ctypes.c_int),
        ("display", ctypes.c_void_p), ("window", ctypes.c_ulong), ("kind", ctypes.c_ulong),
        ("format", ctypes.c_int), ("data", ctypes.c_long * 5), ("rest", ctypes.c_long * 24),
    )  # fmt: skip


class Screen:
    """A separate X server."""

    def __init__(self, width=1100, height=800):
        read, write = os.pipe()
        self.process = subprocess.Popen(
            ["Xvfb", "-displayfd", str(write), "-screen", "0", f"{width}x{height}x24",
             "-nolisten", "tcp", "-noreset"],  # else it resets when its last client disconnects
            pass_fds=[write], stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL,
        )  # fmt: skip
        os.close(write)
        with os.fdopen(read) as pipe:
            self.display = f":{pipe.readline().strip()}"

    def __enter__(self):
        return self

    def __exit__(self, *exc):
        self.process.terminate()
        self.process.wait()

    def hands(self, *words):
        """Run xdotool; returns its output."""
        environment = {**os.environ, "DISPLAY": self.display}
        done = subprocess.run(
            ["xdotool", *map(str, words)], env=environment, capture_output=True, text=True
        )
        return done.stdout.strip()

    def click(self, x, y, button=1):
        self.hands("mousemove", round(x), round(y))
        self.hands("click", button)

    def pixels(self):
        """Red, green and blue of the whole screen, (height, width, 3)."""
        return np.asarray(ImageGrab.grab(xdisplay=self.display).convert("RGB"))

    def window(self):
        """The number of the program's window, its left and its top; None if there is none."""
        windows = self.hands("search", "--onlyvisible", "--class", "minerva").split()
        if not windows:
            return None
        shown = self.hands("getwindowgeometry", "--shell", windows[-1]).splitlines()
        values = dict(line.split("=", 1) for line in shown if "=" in line)
        if "Y" not in values:  # already closed: SDL tries one window before the one that it shows
            return None
        return int(windows[-1]), int(values["X"]), int(values["Y"])

    def ask_to_close(self, window):
        """Send the message that a window manager sends when the user clicks on the close button."""
        x = ctypes.CDLL("libX11.so.6")
        x.XOpenDisplay.restype = ctypes.c_void_p
        x.XInternAtom.restype = ctypes.c_ulong
        display = ctypes.c_void_p(x.XOpenDisplay(self.display.encode()))
        message = Message(type=33, window=window, format=32)
        message.kind = x.XInternAtom(display, b"WM_PROTOCOLS", 0)
        message.data[0] = x.XInternAtom(display, b"WM_DELETE_WINDOW", 0)
        x.XSendEvent(display, ctypes.c_ulong(window), 0, 0, ctypes.byref(message))
        x.XSync(display, 0)
        x.XCloseDisplay(display)
