"""Two machines as deploy/README.md has it: every command of its first chapter, typed as written."""

import re
import shutil
import signal
import subprocess
import sys
from pathlib import Path

import pytest
from hosts import Network, environment, eventually, needs_hosts

pytest.importorskip("prometheus_client")
pytestmark = [
    needs_hosts,
    pytest.mark.skipif(shutil.which("curl") is None, reason="there is no curl"),
]
README = Path(__file__).parents[2] / "deploy" / "README.md"
UNTYPED = ("python3 -m venv", "minerva/bin/pip", ". minerva/bin/activate", "minerva top")
"""What has been done already, and what takes a screen."""

PROGRAMS = {
    "minerva": f'exec {sys.executable} -m minerva_bus.cli.main "$@"',
    "ssh": 'cd "{folder}/$1" && shift && exec "$@"',
    "scp": 'for last; do :; done; place="{folder}/${{last%%:*}}/${{last#*:}}"\n'
    'while [ $# -gt 1 ]; do cp "$1" "$place"; shift; done',
}
"""What the shell finds: of ssh and scp as much as the chapter needs."""


def commands():
    """(host, line) of the chapter, as a reader would type them."""
    chapter = re.search(r"^## Two machines\n(.*?)^##", README.read_text(), re.S | re.M).group(1)
    host = ""
    for text, block in re.findall(r"(.*?)^```sh\n(.*?)^```", chapter, re.S | re.M):
        host = re.findall(r"\*\*On the (\w+)\*\*", text)[-1] if "**On the" in text else host
        for line in block.splitlines():
            if not line.startswith(UNTYPED):
                yield host, line


class Typist:
    """Somebody at the keyboards of two machines."""

    def __init__(self, folder, network):
        self.hosts = {name: network.host(name) for name in ("server", "robot")}
        self.stay = []
        programs = folder / "programs"
        programs.mkdir()
        for name, text in PROGRAMS.items():
            file = programs / name
            file.write_text(f"#!/bin/sh\n{text.format(folder=folder)}\n")
            file.chmod(0o755)
        self.path = f"{programs}:/usr/sbin:/usr/bin:/sbin:/bin"

    def types(self, name, line):
        """A line; what stays is left running, everything else must end well."""
        host = self.hosts[name]
        words = [*host.inside, "bash", "-c", f"exec {line}"]
        there = {"cwd": host.folder, "env": environment(host.folder) | {"PATH": self.path}}
        if line.startswith(("minerva run", "minerva attach")):
            with (host.folder / "log").open("w") as log:
                self.stay.append((host, subprocess.Popen(words, stdout=log, stderr=log, **there)))
            return None
        return subprocess.run(words, capture_output=True, text=True, timeout=60, **there)

    def until(self, name, line, words):
        """Type it again and again until it says something."""

        def said():
            done = self.types(name, line)
            return done.returncode == 0 and words in done.stdout

        try:
            eventually(said, f"{line!r} says {words!r}")
        except AssertionError as error:
            raise AssertionError(f"{error}\n{self.logs()}") from None

    def logs_say(self, words):
        """Wait until somebody has said something."""
        eventually(lambda: words in self.logs(), f"somebody says {words!r}")

    def logs(self):
        return "\n".join((host.folder / "log").read_text() for host, _ in self.stay)

    def ends(self):
        """Ctrl-C everywhere, the last one first; the exit codes."""
        codes = []
        for _, process in reversed(self.stay):
            process.send_signal(signal.SIGINT)
            codes.append(process.wait(40))
        return codes


def test_a_new_user_s_path_on_two_machines(tmp_path):
    with Network(tmp_path) as network:
        typist = Typist(tmp_path, network)
        for host, line in commands():
            if line.startswith("minerva attach"):
                typist.until("server", "minerva list", "robots")
            if line.startswith("minerva list"):
                typist.until(host, line, "robots-2")
            elif line.startswith("curl"):
                typist.until(host, line, "")
            else:
                done = typist.types(host, line)
                assert done is None or done.returncode == 0, f"{line}\n{done.stderr}"
        assert len(typist.stay) == 2
        robot = typist.hosts["robot"]
        robot.link("down")
        typist.logs_say("robots-2 │ is gone; other hosts take its agents over")
        typist.logs_say("cannot be seen since")
        robot.link("up")
        typist.until("server", "minerva list", "robots-2")
        typist.logs_say("is back after")
        assert typist.ends() == [0, 130], typist.logs()
    assert "Traceback" not in typist.logs()
    assert oct((tmp_path / "server" / "keys").stat().st_mode & 0o777) == "0o700"


def test_there_are_commands_to_type():
    typed = [line.split()[:2] for _, line in commands()]
    for words in (
        ["minerva", "keys"],
        ["minerva", "run"],
        ["minerva", "attach"],
        ["scp", "keys/ca.pem"],
    ):
        assert words in typed
    assert {host for host, _ in commands()} == {"server", "robot"}
