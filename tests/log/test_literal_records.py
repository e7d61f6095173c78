"""A world with the literal policy: its record in any layout, recomputed, resumed, swapped."""

import pytest

from tests.runtime.running import here, minerva, summary, write_world

pytest.importorskip("mcap", reason="pip install 'minerva-bus[record]'")

YEAST = """
from minerva_bus import EMPTY, Agent, EventType, Generator, Primitive, Vocabulary, on

PBowl = Primitive("PBowl")
eFeed, eStir, eEaten = EventType("eFeed"), EventType("eStir"), EventType("eEaten")


class Yeast(Agent, symbol="AYeast"):
    fed: int = 0
    births: int = 0

    @on("eFeed")
    def feed(self, event, moment):
        self.fed += 1
        if moment.chance.chance(0.5):
            if moment.number == 0:
                moment.emit(eEaten())
            return self.string + self.child()

    @on("eStir")
    def stir(self, event, moment):
        return EMPTY if moment.chance.chance(0.6) else None


class Crumb(Agent, symbol="ACrumb"):
    @on("eStir")
    def sink(self, event, moment):
        return EMPTY


class Cook(Generator, events=("eFeed", "eStir")):
    def generate(self, tick):
        return [eFeed(), eStir()] if tick.number % 2 else [eFeed()]


vocabulary = Vocabulary.of(PBowl, eFeed, eStir, eEaten, Yeast, Crumb)
"""
MEMBERS = """
[process.cook]
service = "yeast:Cook"

[process.yeast]
agents = ["yeast:Yeast", "yeast:Crumb"]
"""
STRING = "PBowl · AYeast#a · AYeast#b(ACrumb#c) · AYeast#d"


@pytest.fixture(scope="module")
def recorded(tmp_path_factory):
    """A folder with a world file and the record of its run in one process, digest and frames."""
    folder = tmp_path_factory.mktemp("letter")
    (folder / "yeast.py").write_text(YEAST)
    path = write_world(
        folder, MEMBERS, STRING, name="letter", policy="literal", frames=5, vocabulary=0
    )
    path.write_text(path.read_text().replace("vocabulary = 0\n", "").replace("yard:", "yeast:"))
    done = summary(here(folder, "run", path, "--in-process", "--record", "one.mcap", "--json"))
    return folder, path, done["digest"], done["frames"]


def test_a_run_on_a_bus_makes_the_record_of_one_process(recorded):
    folder, path, digest, frames = recorded
    words = ("run", path, "--processes", "auto", "--record", "two.mcap", "--json")
    done = summary(minerva(folder, *words))
    assert (done["digest"], done["frames"]) == (digest, frames)
    done = here(folder, "diff", "one.mcap", "two.mcap")
    assert done.returncode == 0, done.stdout


def test_a_second_host_is_refused(recorded):
    folder, path, *_ = recorded
    done = here(folder, "run", path, "--set", "yeast.processes=2")
    assert done.returncode != 0
    why = 'policy = "literal" evolves all agents on one host, but [process.yeast]'
    assert f"{why} has 2 processes; use processes = 1" in done.stderr
    two = folder / "two.toml"
    tables = '[process.yeast]\nagents = "yeast:Yeast"\n[process.crumb]\nagents = "yeast:Crumb"\n'
    own = '[process.yeast]\nagents = ["yeast:Yeast", "yeast:Crumb"]\n'
    assert own in path.read_text()
    two.write_text(path.read_text().replace(own, tables))
    done = here(folder, "check", two)
    assert done.returncode != 0
    assert f"{why} and [process.crumb] have agents; name all classes in" in done.stderr


def test_it_is_recomputed_and_swapped(recorded):
    folder, *_ = recorded
    done = here(folder, "replay", "one.mcap", "--recompute")
    assert done.returncode == 0, done.stdout
    done = here(folder, "swap", "one.mcap", "cook=yeast:Cook")
    assert done.returncode == 0, done.stdout + done.stderr


def test_it_goes_on_from_a_frame_with_copies(recorded):
    folder, path, digest, frames = recorded
    words = ("run", path, "--in-process", "--frames", 3, "--record", "cut.mcap", "--json")
    summary(here(folder, *words))
    words = ("run", path, "--resume", "cut.mcap", "--frames", 5, "--record", "on.mcap")
    done = summary(minerva(folder, *words, "--json"))
    assert (done["digest"], done["frames"]) == (digest, frames)
    assert here(folder, "diff", "one.mcap", "on.mcap").returncode == 0


def test_an_id_of_a_future_copy_is_rejected(recorded):
    folder, path, *_ = recorded
    wrong = folder / "wrong.toml"
    wrong.write_text(
        path.read_text().replace("AYeast#d", "AYeast#a:4-2").replace("letter", "wrong")
    )
    done = here(folder, "check", wrong)
    assert done.returncode != 0
    assert "AYeast#a:4-2 has the id of a copy that frame 4 makes" in done.stderr
    assert len(done.stderr.splitlines()) <= 10
    assert "Traceback" not in done.stderr
