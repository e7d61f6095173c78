"""A reader who types the commands of a page on the machines of a network."""

import re
import shlex
import signal
import subprocess
import sys

from hosts import environment, eventually

PROGRAMS = {
    "minerva": f'exec {sys.executable} -m minerva_bus.cli.main "$@"',
    "ssh": 'cd "{folder}/$1" && shift && exec "$@"',
    "scp": 'for last; do :; done; place="{folder}/${{last%%:*}}/${{last#*:}}"\n'
    'while [ $# -gt 1 ]; do cp "$1" "$place"; shift; done',
}
"""Programs in the shell's path; ssh and scp as far as the chapter uses them."""

SHELL = re.compile(r"[$`\\*?~;|&<>]")
"""What needs a shell; tests/starts.py starts other commands without the time of their imports."""


class Typist:
    """Types commands on machines with these names."""

    def __init__(self, folder, network, names):
        self.hosts = {name: network.host(name) for name in names}
        self.stay = []
        programs = folder / "programs"
        programs.mkdir()
        for name, text in PROGRAMS.items():
            file = programs / name
            file.write_text(f"#!/bin/sh\n{text.format(folder=folder)}\n")
            file.chmod(0o755)
        self.path = f"{programs}:/usr/sbin:/usr/bin:/sbin:/bin"

    def types(self, name, line):
        """Run a line; worlds and attached members keep running and return None."""
        host = self.hosts[name]
        if line.startswith("minerva ") and not SHELL.search(line):
            words = [sys.executable, "-m", "minerva_bus.cli.main", *shlex.split(line)[1:]]
        else:
            words = ["bash", "-c", f"exec {line}"]
        words = [*host.inside, *words]
        there = {"cwd": host.folder, "env": environment(host.folder) | {"PATH": self.path}}
        if line.startswith(("minerva run", "minerva attach")):
            with (host.folder / "log").open("w") as log:
                self.stay.append((host, subprocess.Popen(words, stdout=log, stderr=log, **there)))
            return None
        return subprocess.run(words, capture_output=True, text=True, **there)

    def until(self, name, line, words):
        """Repeat a command until it succeeds and its output has `words`."""

        def said():
            done = self.types(name, line)
            return done.returncode == 0 and words in done.stdout

        try:
            eventually(said, f"{line!r} says {words!r}")
        except AssertionError as error:
            raise AssertionError(f"{error}\n{self.logs()}") from None

    def logs_say(self, words):
        """Wait until some log has `words`."""
        eventually(lambda: words in self.logs(), f"somebody says {words!r}")

    def logs(self):
        return "\n".join((host.folder / "log").read_text() for host, _ in self.stay)

    def ends(self):
        """Press Ctrl-C in all processes, the last one first; returns the exit codes."""
        codes = []
        for _, process in reversed(self.stay):
            process.send_signal(signal.SIGINT)
            codes.append(process.wait())
        return codes
