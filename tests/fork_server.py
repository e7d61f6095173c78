"""A process that has imported Minerva Bus, and forks a child for each command to run.

A new interpreter spends most of the CPU time of a short command on imports. The tests start
thousands of commands, so `tests/starts.py` requests them here:

    python tests/fork_server.py SOCKET

The child has the arguments, environment, folder, standard files and parent of a process that the
requesting process has started itself, and imports the command line again.
"""

import ctypes
import fcntl
import gc
import io
import json
import os
import runpy
import signal
import socket
import sys
import termios
import time
from pathlib import Path

LARGEST = 1 << 17
"""Maximum size of a request, bytes: a message of a socket has to fit into its buffer."""


def preload():
    """Import what `minerva run` imports, except the command line itself.

    The command line measures when its process started, and is executed as the main module.
    """
    import minerva_bus
    import minerva_bus.cli.main
    import minerva_bus.cli.running

    for name in [*sys.modules]:
        if name == "minerva_bus.cli" or name.startswith("minerva_bus.cli."):
            del sys.modules[name]
    del minerva_bus.cli
    gc.collect()
    gc.freeze()  # Collecting these objects in a child would copy their pages.


def serve(requests):
    """Answer each request with the process id of a child; in the child, return the request.

    The requesting process becomes the parent of the child, because it has declared itself the
    reaper of orphans, and the process between them ends at once.
    """
    while True:
        message, files, _, _ = socket.recv_fds(requests, LARGEST, 3)
        if not message:
            return None
        read, write = os.pipe()
        between = os.fork()
        if not between:
            child = os.fork()
            if not child:
                return json.loads(message), files
            os.write(write, str(child).encode())
            os._exit(0)
        os.close(write)
        for file in files:
            os.close(file)
        os.waitpid(between, 0)
        requests.send(os.read(read, 20))
        os.close(read)


def become(request, files):
    """Give this process the standard files, environment and folder of a request."""
    signal.signal(signal.SIGINT, signal.default_int_handler)
    if request["session"]:
        os.setsid()
    for number, file in enumerate(files):
        os.dup2(file, number)
    if request["terminal"]:
        fcntl.ioctl(0, termios.TIOCSCTTY, 0)
    os.closerange(3, os.sysconf("SC_OPEN_MAX"))
    os.environ.clear()
    os.environ.update(request["environment"])
    show([sys.executable, *request["program"], *request["arguments"]])
    time.tzset()
    os.chdir(request["folder"])
    unbuffered = bool(os.environ.get("PYTHONUNBUFFERED"))
    sys.stdin = sys.__stdin__ = text_file(sys.stdin, 0, "r", unbuffered)
    sys.stdout = sys.__stdout__ = text_file(sys.stdout, 1, "w", unbuffered)
    sys.stderr = sys.__stderr__ = text_file(sys.stderr, 2, "w", unbuffered, by_line=not unbuffered)


def show(words):
    """Let `ps` show the words of the command, as far as they fit, by which tests find processes.

    They replace the words of the server and its environment, which nothing reads any more.
    """
    stat = Path("/proc/self/stat").read_text().rpartition(") ")[2].split()
    begin, end, last = int(stat[45]), int(stat[46]), int(stat[48])
    shown = " ".join(words).encode("utf-8", "surrogateescape")[: last - begin - 1]
    ctypes.memmove(begin, shown.ljust(end - begin, b"\0") + b"\0", max(len(shown), end - begin) + 1)


def text_file(former, number, mode, unbuffered, by_line=False):
    """A standard file as the interpreter opens it, with the encoding of a former one."""
    buffer = open(number, f"{mode}b", 0 if unbuffered and mode == "w" else -1, closefd=False)  # noqa: SIM115
    raw = getattr(buffer, "raw", buffer)
    raw.name = former.name
    file = io.TextIOWrapper(
        buffer, encoding=former.encoding, errors=former.errors, newline=None if mode == "r" else "\n",
        line_buffering=by_line or (raw.isatty() and not unbuffered), write_through=unbuffered,
    )  # fmt: skip
    file.mode = mode
    return file


def run(program, arguments):
    """Execute a module or a script with arguments, as the interpreter does."""
    sys.argv = [program[-1], *arguments]
    if program[0] == "-m":
        sys.path[0] = str(Path.cwd())
        runpy.run_module(program[-1], run_name="__main__", alter_sys=True)
    else:
        sys.path[0] = str(Path(program[-1]).parent)
        runpy.run_path(program[-1], run_name="__main__")


if __name__ == "__main__":
    # Ctrl-C in a terminal reaches all processes of its group; the children handle it.
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    preload()
    started = serve(socket.socket(fileno=int(sys.argv[1])))
    if started is not None:
        become(*started)
        run(started[0]["program"], started[0]["arguments"])
