"""A process that has imported Minerva Bus, and forks a child for each command to run.

A new interpreter spends most of the CPU time of a short command on imports. The tests start
thousands of commands, so `tests/starts.py` requests them here:

    python tests/fork_server.py SOCKET

The child has the arguments, environment, folder, standard files and parent of a process that the
requesting process has started itself, and imports the command line again. It does not outlive that
process, which may be killed.
"""

import atexit
import contextlib
import ctypes
import fcntl
import gc
import importlib.metadata
import io
import json
import os
import pkgutil
import runpy
import signal
import socket
import sys
import termios
import threading
import time
from importlib.machinery import SourceFileLoader
from pathlib import Path
from types import ModuleType

NEW_MOUNTS, BIND, SLAVE = 0x20000, 0x1000, 0x84000
"""CLONE_NEWNS, MS_BIND, and MS_SLAVE with MS_REC in Linux."""
SET_PARENT_DEATH_SIGNAL = 1
"""The number of PR_SET_PDEATHSIG in Linux."""
LARGEST = 1 << 17
"""Maximum size of a request, bytes: a message of a socket has to fit into its buffer."""


PRELOADED = (
    *("minerva_bus.api", "minerva_bus.cli", "minerva_bus.collect", "minerva_bus.grammar"),
    *("minerva_bus.launch", "minerva_bus.log", "minerva_bus.runtime", "minerva_bus.semantics"),
    *("minerva_study", "minerva_bus.world", "minerva_services.input.each"),
    *(
        "minerva_services.input.recorded",
        "minerva_services.options",
        "minerva_services.sensors.laser",
    ),
    *("minerva_services.physics", "minerva_services.views.svg", "minerva_agents.robot.robot"),
    *("minerva_agents.robot.world", "minerva_agents.robot.mapping"),
    *(
        "encodings.utf_8_sig",
        "mcap.reader",
        "mcap.writer",
        "pymunk",
        "scipy.spatial",
        "unicodedata",
    ),
)
"""What most commands of the tests import: packages of the project with all of their modules."""
HEAVY = ("minerva_conformance.score_card_output",)
"""Modules of these packages that few commands import, and that take long."""
MAIN = ("minerva_bus.api.child", "minerva_bus.cli.main")
"""Modules that are executed as the main module, which must not be imported before."""


def preload():
    """Import what the commands of the tests import, except what is executed as the main module.

    Returns the names of all imported modules, and the folders of installed packages.
    """
    for name in PRELOADED:
        with contextlib.suppress(ImportError):  # An optional package is not installed.
            load(name)
    for name in MAIN:
        del sys.modules[name]
    del sys.modules["minerva_bus.cli"].main, sys.modules["minerva_bus.api"].child
    sys.modules["minerva_bus.entry_points"]._all_entries()
    gc.collect()
    gc.freeze()  # Collecting these objects in a child would copy their pages.
    return {*sys.modules}, package_folders()


def load(name):
    """Import a module, and all modules of a package of the project."""
    module = importlib.import_module(name)
    if not name.startswith("minerva_"):
        return
    for _, inner, _ in pkgutil.iter_modules(getattr(module, "__path__", ()), f"{name}."):
        if inner not in HEAVY:
            load(inner)


def package_folders():
    """The folders that are searched for installed packages, and when each last changed."""
    folders = filter(Path.is_dir, map(Path, sys.path[1:]))
    return {folder: folder.stat().st_mtime_ns for folder in folders}


def renew(folders):
    """Renew what was computed for the server: when the program began, and what is installed."""
    sys.modules["minerva_bus.process_life"].BEGAN = time.monotonic() - time.process_time()
    beside = importlib.metadata.distributions(path=sys.path[:1])
    if folders != package_folders() or next(iter(beside), None):
        sys.modules["minerva_bus.entry_points"]._all_entries.cache_clear()


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
            between = os.getpid()
            child = os.fork()
            if not child:
                while os.getppid() == between:  # The command must see its final parent.
                    os.sched_yield()
                return json.loads(message), files
            os.write(write, str(child).encode())
            os._exit(0)
        os.close(write)
        for file in files:
            os.close(file)
        os.waitpid(between, 0)
        requests.send(os.read(read, 20))
        os.close(read)


def end_with_parent(parent):
    """Let the system kill this process when its parent, a process id, ends, also by a signal."""
    ctypes.CDLL(None).prctl(SET_PARENT_DEATH_SIGNAL, signal.SIGKILL)
    if os.getppid() != parent:  # It has ended just before.
        os.kill(os.getpid(), signal.SIGKILL)


def become(request, files):
    """Give this process the standard files, environment and folder of a request."""
    signal.signal(signal.SIGINT, signal.default_int_handler)
    # The server ignores it if the tests run under nohup.
    signal.signal(signal.SIGHUP, signal.SIG_IGN if request["nohup"] else signal.SIG_DFL)
    end_with_parent(request["parent"])
    if request["session"]:
        os.setsid()
    for number, file in enumerate(files):
        os.dup2(file, number)
    if request["terminal"]:
        fcntl.ioctl(0, termios.TIOCSCTTY, 0)
    os.closerange(3, os.sysconf("SC_OPEN_MAX"))
    enter(request["namespaces"], request["covers"])
    os.environ.clear()
    os.environ.update(request["environment"])
    show([sys.executable, *request["program"], *request["arguments"]])
    time.tzset()
    os.chdir(request["folder"])
    unbuffered = bool(os.environ.get("PYTHONUNBUFFERED"))
    sys.stdin = sys.__stdin__ = text_file(sys.stdin, 0, "r", unbuffered)
    sys.stdout = sys.__stdout__ = text_file(sys.stdout, 1, "w", unbuffered)
    sys.stderr = sys.__stderr__ = text_file(sys.stderr, 2, "w", unbuffered, by_line=not unbuffered)


def enter(namespaces, covers):
    """Enter namespaces, each given by a file, and cover files in /etc, as `ip netns exec` does."""
    libc = ctypes.CDLL(None, use_errno=True)

    def call(function, *arguments):
        if function(*arguments):
            raise OSError(ctypes.get_errno(), os.strerror(ctypes.get_errno()))

    # All are opened before the first can hide the others.
    for file in [os.open(path, os.O_RDONLY | os.O_CLOEXEC) for path in namespaces]:
        call(libc.setns, file, 0)
        os.close(file)
    if covers is not None and Path(covers).is_dir():
        call(libc.unshare, NEW_MOUNTS)
        call(libc.mount, b"", b"/", b"none", SLAVE, None)  # The machine does not see these mounts.
        for path in Path(covers).iterdir():
            call(libc.mount, bytes(path), bytes(Path("/etc", path.name)), b"none", BIND, None)


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


def search_first(folders):
    """Search folders before the installed packages; whether they hide nothing that is imported."""
    homes = {}
    for folder in map(Path, folders):
        for file in files_of(folder):
            homes.setdefault(file.name.partition(".")[0], folder)
    for name in homes.keys() & {*sys.modules, "sitecustomize", "usercustomize"}:
        file = getattr(sys.modules.get(name), "__file__", None)
        if file is None or homes[name] not in Path(file).parents:
            return False
    sys.path[1:] = dict.fromkeys([*folders, *sys.path[1:]])
    return True


def files_of(folder):
    """The files in a folder; none if it is an archive, or nothing."""
    return folder.iterdir() if folder.is_dir() else ()


def run(program, arguments, folders):
    """Execute a module or a script with arguments, as the interpreter does."""
    words = [*program, *arguments]
    paths = os.environ.get("PYTHONPATH", "")
    if paths and not search_first([os.path.abspath(path) for path in paths.split(os.pathsep)]):  # noqa: PTH100
        os.execv(sys.executable, [sys.executable, *words])
    sys.argv = words[len(program) - 1 :]
    sys.path[0] = str(Path.cwd() if program[0] == "-m" else Path(program[-1]).resolve().parent)
    renew(folders)
    if program[0] == "-m":
        runpy.run_module(program[-1], run_name="__main__", alter_sys=True)
    else:
        run_script(os.path.join(os.getcwd(), program[-1]))  # noqa: PTH109, PTH118 (keeps a dot)


def run_script(path):
    """Execute a file as the main module; runpy would replace the first argument by its path."""
    own, module = sys.modules["__main__"], ModuleType("__main__")
    module.__file__ = path
    module.__loader__ = SourceFileLoader("__main__", path)
    sys.modules["__main__"] = module
    try:
        exec(compile(module.__loader__.get_data(path), path, "exec"), module.__dict__)
    finally:
        sys.modules["__main__"] = own


def end(code, preloaded):
    """End as the interpreter does, but keep what the server has imported.

    To destroy it would copy most pages of the server, which takes longer than a short command.
    An error of a standard file is left to the interpreter.
    """
    threading._shutdown()
    atexit._run_exitfuncs()
    for name in sys.modules.keys() - preloaded:
        del sys.modules[name]
    gc.collect()
    with contextlib.suppress(OSError, ValueError):
        sys.stdout.flush()
        sys.stderr.flush()
        os._exit(code)
    sys.exit(code)


if __name__ == "__main__":
    # Ctrl-C in a terminal reaches all processes of its group; the children handle it.
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    modules, folders = preload()
    started = serve(socket.socket(fileno=int(sys.argv[1])))
    if started is not None:
        become(*started)
        code = 0
        try:
            run(started[0]["program"], started[0]["arguments"], folders)
        except SystemExit as left:
            if not isinstance(left.code, int | None):
                raise
            code = left.code or 0
        end(code, modules)
