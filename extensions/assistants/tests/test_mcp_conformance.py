"""The MCP server against the conformance suite of the protocol's authors, an npm package.

pytest -m slow extensions/assistants/tests/test_mcp_conformance.py

"""

import re
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

from tests.runtime.running import World, environment, eventually, write_world

SUITE = (
    "npx", "--yes", "--package=node@22", "--package=@modelcontextprotocol/conformance@0.1.16",
    "--", "conformance",
)  # fmt: skip
MEMBERS = """
[process.walkers]
agents = "yard:Walker"
"""
ROOT = Path(__file__).parents[3]
BASELINE = Path(__file__).with_name("conformance_baseline.yml")
pytestmark = [
    pytest.mark.slow,
    pytest.mark.skipif(shutil.which("npx") is None, reason="needs npx of npm"),
]


@pytest.fixture(scope="module")
def world(tmp_path_factory):
    problem = suite("--version")
    if problem.returncode:
        pytest.skip(f"npm cannot install the suite: {problem.stderr[-300:]}")
    path = write_world(tmp_path_factory.mktemp("conforming"), MEMBERS, frames=0, rate=10)
    with World(path) as world:
        world.runs("walkers")
        yield world


def suite(*words, folder=None):
    return subprocess.run([*SUITE, *words], cwd=folder, capture_output=True, text=True)


@pytest.fixture
def conform(world, tmp_path):
    """A function that runs the suite against a server; returns exit code, counts and output."""

    def run(server, *words):
        settings = {**environment(world.folder), "PYTHONPATH": str(ROOT)}
        log = (tmp_path / "server.log").open("w+")
        process = subprocess.Popen(
            [sys.executable, "-m", *server], cwd=ROOT, env=settings, stdout=log, stderr=log
        )
        try:
            url = eventually(lambda: address(Path(log.name).read_text()), "the server's address")
            done = suite("server", "--url", url, *words, folder=tmp_path)
        finally:
            process.terminate()
            process.wait()
            log.close()
        counts = re.search(r"Total: (\d+) passed, (\d+) failed", done.stdout)
        return done.returncode, *map(int, counts.groups()), done.stdout

    return run


def address(text):
    match = re.search(r"http://\S+/mcp", text)
    return match and match[0]


def test_the_server_passes_all_scenarios_with_the_suite_s_own_tools(world, conform):
    code, passed, failed, output = conform(["tests.assistants.reference_server", world.name])
    assert (code, failed) == (0, 0), output
    assert passed >= 40


def test_minerva_mcp_fails_only_what_it_does_not_offer(world, conform):
    server = ["minerva_bus", "mcp", world.name, "--listen", "127.0.0.1:0"]
    code, passed, failed, output = conform(server, "--expected-failures", str(BASELINE))
    assert code == 0, output
    assert (passed, failed) == (10, 22)
