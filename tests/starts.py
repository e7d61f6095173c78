"""Start `minerva` and `python SCRIPT.py` by a fork of a process that has imported Minerva Bus already.

Tests start the command by `subprocess` as usual; this plugin replaces only how its process begins.
`--new-interpreters` begins each command with a new interpreter, and so does every start whose
arguments concern the interpreter: PYTHONHASHSEED and the like, limits, users, other files.
"""

import ctypes
import fcntl
import inspect
import json
import os
import signal
import socket
import subprocess
import sys
import termios
import threading
from collections import deque
from itertools import chain
from pathlib import Path

from tests.fork_server import LARGEST

INITIAL = dict(os.environ)
"""The environment of the servers."""
SERVER = Path(__file__).with_name("fork_server.py")
PROGRAMS = (
    ["-m", "minerva_bus"],
    ["-m", "minerva_bus.cli.main"],
    ["-m", "minerva_bus.api.child"],
    ["-m", "minerva_conformance.coordinator"],
    [str(Path(sys.executable).with_name("minerva"))],
)
"""The words after the interpreter that start the command line, a world of the Python interface, or a
coordinator."""
SCRIPT = ".py"
"""The end of the word after the interpreter that starts a script."""
SERVERS = 2
"""Number of servers that take turns. Each has a hash seed, so two successive commands have
different ones: if a result depends on the order of a set, their results differ."""
SET_CHILD_SUBREAPER = 36
"""The number of PR_SET_CHILD_SUBREAPER in Linux."""
ENTERED = {"--user": "user", "--net": "net", "--mount": "mnt"}
"""The namespaces that options of `nsenter` enter, in the order in which a process can."""
CREDENTIALS = "--preserve-credentials"
FIXED = {
    "executable": None, "close_fds": True, "pass_fds": (), "shell": False,
    "restore_signals": True, "gid": None, "gids": None, "uid": None, "umask": -1,
    "process_group": -1,
}  # fmt: skip
"""Arguments of a start, each with the only value that a fork of a server can have."""


def take_terminal():
    """Make the standard input the terminal of a new session: the `preexec_fn` that a fork knows."""
    fcntl.ioctl(0, termios.TIOCSCTTY, 0)


def pytest_addoption(parser):
    parser.getgroup("general").addoption(
        "--new-interpreters",
        action="store_true",
        help="start each command of the tests with a new interpreter, not with a fork of a process "
        "that has imported Minerva Bus",
    )


def pytest_configure(config):
    if sys.platform == "linux" and not config.getoption("new_interpreters"):
        config.pluginmanager.register(Starts(), "starts")


class Server:
    """The requesting end of the socket of a fork server with an environment."""

    def __init__(self, environment):
        self.socket, remote = socket.socketpair(socket.AF_UNIX, socket.SOCK_SEQPACKET)
        with remote:
            self.process = subprocess.Popen(
                [sys.executable, SERVER, str(remote.fileno())],
                pass_fds=[remote.fileno()], stdin=subprocess.DEVNULL, env=environment,
            )  # fmt: skip

    def start(self, request, files):
        """Start a command as a child of this process; returns its process id."""
        prctl = ctypes.CDLL(None).prctl
        prctl(SET_CHILD_SUBREAPER, 1)
        try:
            socket.send_fds(self.socket, [request], files)
            return int(self.socket.recv(20))
        finally:
            prctl(SET_CHILD_SUBREAPER, 0)

    def close(self):
        self.socket.close()
        self.process.wait()


class Starts:
    """Forked starts from the beginning to the end of a test session."""

    def __init__(self):
        self.original = subprocess.Popen._execute_child
        self.signature = inspect.signature(self.original)
        self.servers = {}
        self.lock = threading.Lock()

    def pytest_sessionstart(self):
        def execute_child(process, *arguments):
            if not self.fork(process, self.signature.bind(process, *arguments).arguments):
                self.original(process, *arguments)

        subprocess.Popen._execute_child = execute_child

    def pytest_unconfigure(self):
        subprocess.Popen._execute_child = self.original
        for server in chain(*self.servers.values()):
            server.close()

    def server(self, environment, elsewhere):
        """The next server with the interpreter settings of an environment.

        Commands that run elsewhere, in a namespace, have few variables, so they have servers even if
        these are not the settings of this process.
        """
        settings = interpreter_settings(environment)
        own = settings == interpreter_settings(INITIAL)
        key = tuple(sorted(settings.items()))
        if key not in self.servers:
            if not own and not elsewhere:
                return None
            begun = INITIAL if own else environment
            self.servers[key] = deque(Server(begun) for _ in range(SERVERS))
        self.servers[key].rotate()
        return self.servers[key][0]

    def fork(self, process, arguments):
        """Start a process by a fork; returns whether that was possible."""
        request = forkable(arguments)
        if request is None:
            return False
        data = json.dumps(request).encode()
        if len(data) >= LARGEST:
            return False
        pipes = [arguments[name] for name in ("p2cread", "c2pwrite", "errwrite")]
        files = [number if pipe == -1 else pipe for number, pipe in enumerate(pipes)]
        with self.lock:
            server = self.server(request["environment"], request["namespaces"])
            if server is None:
                return False
            process.pid = server.start(data, files)
        process._child_created = True
        ends = ("p2cread", "p2cwrite", "c2pread", "c2pwrite", "errread", "errwrite")
        process._close_pipe_fds(*(arguments[end] for end in ends))
        return True


def forkable(arguments):
    """The request of a start; None: it needs a new interpreter."""
    words = arguments["args"]
    if isinstance(words, (str, bytes, os.PathLike)):
        return None
    words = [*map(os.fspath, words)]
    begin = words.index(sys.executable) if sys.executable in words else 0
    inside, words = tuple(words[:begin]), words[begin:]
    places = namespaces(inside)
    program = next((p for p in PROGRAMS if words[: len(p) + 1] == [sys.executable, *p]), None)
    if program is None and words[0] == sys.executable and words[1:] and words[1].endswith(SCRIPT):
        program = words[1:2]
    if program is None or places is None:
        return None
    if any(arguments.get(name, value) != value for name, value in FIXED.items()):
        return None
    if arguments.get("preexec_fn") not in (None, take_terminal):
        return None
    folder = str(Path(arguments["cwd"] or ".").absolute())
    if not os.access(folder, os.X_OK):
        return None
    return {
        "parent": os.getpid(), "program": program, "arguments": words[len(program) + 1 :],
        "environment": dict(os.environ if arguments["env"] is None else arguments["env"]),
        "namespaces": places[0], "covers": places[1], "folder": folder, "session": arguments["start_new_session"],
        "terminal": arguments.get("preexec_fn") is take_terminal,
        "nohup": signal.getsignal(signal.SIGHUP) is signal.SIG_IGN,
    }  # fmt: skip


def namespaces(inside):
    """What the words before a command enter; None: it is not known.

    Args:
        inside: words of `nsenter` or `ip netns exec`, or none.

    Returns:
        The files of the namespaces, and the folder whose files cover those in /etc; None: no folder.

    """
    if inside[-2:-1] == ("--chdir",):  # `nsenter` leaves the folder, and `env --chdir` returns.
        inside = inside[:-3]
    match inside:
        case ():
            return [], None
        case ("nsenter", "--target", pid, *options):
            kinds = [ENTERED.get(option) for option in options if option != CREDENTIALS]
            return None if None in kinds else ([f"/proc/{pid}/ns/{kind}" for kind in kinds], None)
        case ("ip", "netns", "exec", name):
            return [f"/run/netns/{name}"], f"/etc/netns/{name}"
    return None


def interpreter_settings(environment):
    """Variables that an interpreter reads when it starts, and that a fork cannot apply.

    OpenCV sets LD_LIBRARY_PATH when it is imported, which a test module does during collection.
    The command receives the variable as any other. A fork applies PYTHONPATH unless the servers have
    one of their own.
    """
    read = ("PYTHON", "LC_", "LANG", "LD_")
    applied = {"PYTHONUNBUFFERED", "LD_LIBRARY_PATH", "PYTHONPATH"} - (
        INITIAL.keys() & {"PYTHONPATH"}
    )
    return {
        key: value
        for key, value in environment.items()
        if key.startswith(read) and key not in applied
    }
