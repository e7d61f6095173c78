"""deploy/README.md on two machines: every command of its first chapter, as written."""

import re
import shutil
from pathlib import Path

import pytest
from hosts import Network, needs_hosts
from typist import Typist

pytest.importorskip("prometheus_client")
pytestmark = [
    needs_hosts,
    pytest.mark.skipif(shutil.which("curl") is None, reason="there is no curl"),
]
README = Path(__file__).parents[2] / "deploy" / "README.md"
UNTYPED = ("python3 -m venv", "minerva/bin/pip", ". minerva/bin/activate", "minerva top")
"""Commands to skip: installation steps, and a command that needs a screen."""


def commands():
    """(host, line) of each command of the chapter."""
    chapter = re.search(r"^## Two machines\n(.*?)^##", README.read_text(), re.S | re.M).group(1)
    host = ""
    for text, block in re.findall(r"(.*?)^```sh\n(.*?)^```", chapter, re.S | re.M):
        host = re.findall(r"\*\*On the (\w+)\*\*", text)[-1] if "**On the" in text else host
        for line in block.splitlines():
            if not line.startswith(UNTYPED):
                yield host, line


def test_a_new_user_s_path_on_two_machines(tmp_path):
    with Network(tmp_path) as network:
        typist = Typist(tmp_path, network, ("server", "robot"))
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
        typist.logs_say("has been unreachable since")
        robot.link("up")
        typist.until("server", "minerva list", "robots-2")
        typist.logs_say("is reachable again after")
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
