"""Journals of earlier versions are readable and lead to the original strings.

    PYTHONPATH=tests/log python -m test_old_journals

writes a journal of the current version; those of earlier versions remain. The world is the simulated
one: a change of its vocabulary or rules invalidates the journals.
"""

import json
from itertools import count
from pathlib import Path

import pytest

from minerva_bus.frame.algorithm import FrameAlgorithm
from minerva_bus.frame.messages import PROTOCOL_VERSION
from minerva_bus.frame.stimuli import Begin, FrameDone
from minerva_bus.log.entries import FORMAT
from minerva_bus.log.journal import Journal, read_journal, resume_from
from minerva_bus.runtime.runner import InProcessRunner
from tests.simulator.worlds import processes, world

CORPUS = Path(__file__).with_name("corpus")
FRAMES = 6


def write(path):
    """Write the journal of an unfinished run, and beside it the expected digests."""
    digests = []

    def watch(instruction):
        if isinstance(instruction, FrameDone):
            digests.append(instruction.record.digest.hex())
            journal.frame(instruction.inputs)

    algorithm = FrameAlgorithm(world(FRAMES + 1))
    journal = Journal(path, 1, algorithm)
    members = [process.make_member() for process in processes({}, count(1))]
    runner = InProcessRunner(algorithm, members, watch)
    runner.start()
    for _ in range(FRAMES):
        runner.handle(Begin())
    journal.close(over=False)
    path.with_name(f"{path.name}.json").write_text(json.dumps({"digests": digests}) + "\n")


@pytest.mark.parametrize("path", sorted(CORPUS.glob("*.journal")), ids=lambda path: path.stem)
def test_a_journal_of_an_earlier_version_is_gone_on_from(path):
    digests = []
    past = read_journal(path, world(FRAMES + 1))
    algorithm = FrameAlgorithm(past.world)
    resume_from(past, algorithm, lambda done: digests.append(done.record.digest.hex()))
    assert digests == json.loads(path.with_name(f"{path.name}.json").read_text())["digests"]
    assert algorithm.scene.digest.hex() == digests[-1]


def test_there_is_a_journal_of_this_version():
    assert (CORPUS / f"format-{FORMAT}-protocol-{PROTOCOL_VERSION}.journal").exists()


if __name__ == "__main__":
    write(CORPUS / f"format-{FORMAT}-protocol-{PROTOCOL_VERSION}.journal")
