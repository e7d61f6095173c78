"""Runs resume where their records end, in one process or many, with the same result."""

import json

import pytest
from running import ALL_KINDS, World, eventually, here, minerva, summary, write_world

from minerva_bus import EventType, Vocabulary
from minerva_bus.launch.past import differing_vocabulary

pytest.importorskip("mcap", reason="pip install 'minerva-bus[record]'")

LOCKSTEP = ALL_KINDS.split("[process.noise]")[0]


def recorded(tmp_path, frames, **world):
    """A world with a record of so many frames, and the summary of an undisturbed run of 30."""
    path = write_world(tmp_path, LOCKSTEP, **world)
    whole = summary(here(tmp_path, "run", path, "--in-process", "--record", "whole.mcap", "--json"))
    words = ("--frames", frames, "--record", "cut.mcap", "--in-process", "--json")
    summary(here(tmp_path, "run", path, *words))
    return path, whole


def same(folder, first, other):
    done = here(folder, "diff", first, other)
    assert done.returncode == 0, done.stdout


@pytest.mark.parametrize("frames", [1, 13, 29])
def test_a_run_in_one_process_goes_on_as_if_it_had_never_stopped(frames, tmp_path):
    _, whole = recorded(tmp_path, frames)
    words = ("--resume", "cut.mcap", "--frames", 30, "--record", "on.mcap", "--in-process")
    done = summary(here(tmp_path, "run", *words, "--json"))
    assert (done["digest"], done["frames"]) == (whole["digest"], 30)
    same(tmp_path, "whole.mcap", "on.mcap")


def test_a_run_goes_on_over_the_bus_in_more_processes(tmp_path):
    path, whole = recorded(tmp_path, 17)
    more = ("--set", "walkers.processes=3", "--record", "on.mcap")
    done = minerva(tmp_path, "run", path, "--resume", "cut.mcap", "--frames", 30, *more, "--json")
    assert summary(done)["digest"] == whole["digest"]
    same(tmp_path, "whole.mcap", "on.mcap")


def test_a_world_that_was_killed_goes_on_in_the_same_record(tmp_path):
    counts = '\n[process.counts]\nservice = "yard:Counts"\n'
    path = write_world(
        tmp_path, LOCKSTEP + counts, frames=0, rate=100, record="run.mcap", flush=0.05
    )
    with World(path) as world:
        world.runs("steps", "walkers")
        with world.client() as asked:
            eventually(lambda: asked.operator.status().frame > 30, "some frames")
        world.kill()
        world.ends()
        world.gone()
    before = json.loads(here(tmp_path, "info", "run.mcap", "--json").stdout)
    assert not before["complete"]
    frames = before["frames"] + 20
    done = minerva(tmp_path, "run", "--resume", "run.mcap", "--frames", frames, "--rate", 0)
    assert done.stderr.count("Counts of [process.counts] changes count and has no `save`") == 1
    words = ("--frames", frames, "--rate", 0, "--record", "whole.mcap", "--in-process", "--json")
    summary(here(tmp_path, "run", path, *words))
    same(tmp_path, "whole.mcap", "run.mcap")
    after = json.loads(here(tmp_path, "info", "run.mcap", "--check", "--json").stdout)
    assert (after["frames"], after["complete"]) == (frames, True)
    kept = json.loads(here(tmp_path, "info", "run.old.mcap", "--json").stdout)
    assert kept["frames"] == before["frames"]
    assert not list(tmp_path.glob("*.part.mcap"))


def test_the_record_supplies_settings_missing_on_the_command_line(tmp_path):
    path = write_world(tmp_path, LOCKSTEP)
    seed = ("--seed", 99, "--name", "other", "--in-process", "--json")
    whole = summary(here(tmp_path, "run", path, *seed))
    summary(here(tmp_path, "run", path, *seed, "--frames", 7, "--record", "cut.mcap"))
    words = ("--resume", "cut.mcap", "--frames", 30, "--in-process", "--json")
    done = summary(here(tmp_path, "run", *words))
    assert (done["digest"], done["seed"], done["world"]) == (whole["digest"], 99, "other")


@pytest.mark.parametrize(
    ("words", "problem"),
    [
        (("--frames", 30, "--seed", 8), "cut.mcap: it is the record of another world: seed 7 is"),
        ((), "this run is over after 5 frames; --frames N continues"),
    ],
)
def test_an_unresumable_record_is_rejected_in_one_line(words, problem, tmp_path):
    recorded(tmp_path, 5)
    done = here(tmp_path, "run", "--resume", "cut.mcap", "--in-process", *words)
    assert done.returncode == 2
    assert problem in done.stderr
    assert len(done.stderr.splitlines()) == 1


def test_another_vocabulary_is_refused(tmp_path):
    path, _ = recorded(tmp_path, 5)
    other = path.with_name("other.toml")
    other.write_text(path.read_text().replace("yard:vocabulary", "fewer:vocabulary"))
    (tmp_path / "fewer.py").write_text(
        "import yard\nfrom minerva_bus import EventType, Vocabulary\n"
        "names = ('PDot', 'TAt', 'eStep', 'eCall', 'eSeen', 'eNoise', 'eWish', 'eShow')\n"
        "vocabulary = Vocabulary.of(*(getattr(yard, one) for one in names), yard.Walker)\n"
    )
    done = here(tmp_path, "run", other, "--resume", "cut.mcap", "--in-process", "--frames", 30)
    assert done.returncode == 2
    assert "its vocabulary is not the one of the world file: the world file lacks " in done.stderr
    assert len(done.stderr.splitlines()) == 1


def test_declarations_that_no_frame_uses_may_have_changed():
    """A record stays usable if only the fates of orders are declared otherwise."""
    before = Vocabulary.of(EventType("eSit"))
    assert not differing_vocabulary(Vocabulary.of(EventType("eSit", replaces="eSit")), before)
    other = Vocabulary.of(EventType("eSit", x=float), EventType("eRun"))
    what = differing_vocabulary(other, before)
    assert what.endswith("it lacks eRun; these are declared otherwise: eSit")


def test_a_world_file_that_has_moved_is_asked_for(tmp_path):
    path, whole = recorded(tmp_path, 5)
    moved = path.rename(tmp_path / "moved.toml")
    words = ("--resume", "cut.mcap", "--frames", 30, "--in-process", "--json")
    done = here(tmp_path, "run", *words)
    assert done.returncode == 2
    assert f"{path} is not here: name it" in done.stderr
    assert summary(here(tmp_path, "run", moved, *words))["digest"] == whole["digest"]


def test_to_run_nothing_is_to_ask_what(tmp_path):
    done = here(tmp_path, "run", "--in-process")
    assert done.returncode == 2
    assert "no world: name one" in " ".join(done.stderr.split())
