"""The launcher rejects an initial string that is too large for its hosts."""

import subprocess
import sys

import pytest
from running import MEMBERS, environment, write_world

from minerva_bus.errors import WorldFileError
from minerva_bus.frame.composition import Composition
from minerva_bus.grammar.vocabulary import Vocabulary
from minerva_bus.launch import coordinator_process
from minerva_bus.launch.process_specs import ProcessSpec
from minerva_bus.world.agent import Agent


class Stone(Agent, symbol="AStone"):
    text: str = ""


VOCABULARY = Vocabulary.of(Stone)


def fragments(*texts):
    string = " · ".join(f'AStone#s{i}<text="{text}">' for i, text in enumerate(texts))
    return Composition(VOCABULARY.read(string)).fragments


def hosts(number):
    return [ProcessSpec(f"stones-{i}", agents=(Stone,)) for i in range(number)]


@pytest.fixture(autouse=True)
def largest(monkeypatch):
    monkeypatch.setattr(coordinator_process, "MAX_BYTES", 1000)


def test_a_world_that_fits_may_start():
    coordinator_process.check_sizes(fragments("x" * 800), hosts(1))
    coordinator_process.check_sizes(fragments("x" * 800, "y" * 800), hosts(2))


def test_fragments_without_a_host_are_not_sent():
    coordinator_process.check_sizes(
        fragments("x" * 5000), [ProcessSpec("other", command=("true",))]
    )


def test_too_much_for_all_hosts_together_is_refused_with_their_number():
    with pytest.raises(
        WorldFileError, match=r"AStone are 2,\d+ bytes .* for 2 processes; .* Use 3 or more "
    ):
        coordinator_process.check_sizes(fragments(*["x" * 800] * 3), hosts(2))


def test_one_agent_that_is_too_long_is_refused_whatever_the_number_of_hosts():
    with pytest.raises(WorldFileError, match=r"the agent s0 with its scope is 1,\d+ bytes"):
        coordinator_process.check_sizes(fragments("x" * 1500), hosts(4))


SMALL = """
from minerva_bus.launch import coordinator_process
coordinator_process.MAX_BYTES = 50
from minerva_bus.cli.main import main
main()
"""


def test_a_world_of_too_long_a_string_ends_at_once(tmp_path):
    done = subprocess.run(
        [sys.executable, "-c", SMALL, "run", write_world(tmp_path, MEMBERS)], cwd=tmp_path,
        env=environment(tmp_path), capture_output=True, text=True, check=False,
    )  # fmt: skip
    assert done.returncode == 1
    assert "AWalker are" in done.stderr
    assert "limited to 50" in done.stderr
    assert "restart" not in done.stderr
    assert "bus at" not in done.stderr
    assert "Traceback" not in done.stderr
