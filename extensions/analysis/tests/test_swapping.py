"""Replay of a record with one member replaced: all other members behave as recorded."""

import json
from typing import Any

import pytest

from minerva_analysis import replay_swapped
from minerva_analysis.swapping import Without
from minerva_bus import Agent, Generator, on, record
from minerva_bus.errors import MisuseError, WorldFileError
from minerva_bus.log.record import Cursor, Record
from tests.api.frogs import Frog, eTick, pond
from tests.runtime.running import ALL_KINDS, here, summary, write_world

pytest.importorskip("mcap", reason="pip install 'minerva-bus[record]'")

LOCKSTEP = ALL_KINDS.split("[process.noise]")[0]
OTHERS = """
from yard import *

class Lame(Walker, symbol="AWalker"):
    @on("eStep")
    def walk(self, step, moment):
        if moment.number < 4:
            return super().walk(step, moment)

class Mute(Walker, symbol="AWalker"):
    @on("eStep")
    def walk(self, step, moment):
        return None

class Slow(Generator, events=("eStep",)):
    def __init__(self, stride: int = 1):
        self.stride = stride

    def generate(self, tick):
        return (eStep(self.stride * tick.number),)

class Deaf(Generator, events=("eSeen",)):
    topics = ("sight",)

class Free(Generator, events=("eStep",), when="freely"):
    pass

class Broken(Generator, events=("eStep",)):
    def generate(self, tick):
        raise ZeroDivisionError("its own fault")

class Paper(Device, draws=("eShow",), when="each frame"):
    def __init__(self):
        self.seen = []

    def show(self, view):
        self.seen.append(len(view.scene))

    def report(self):
        return {"sheets": len(self.seen), "figures": self.seen[-1]}
"""


@pytest.fixture(scope="module")
def recorded(tmp_path_factory):
    """A folder with a world of 30 frames and its records with and without topics; its summary."""
    folder = tmp_path_factory.mktemp("swapped")
    path = write_world(folder, LOCKSTEP, frames=30)
    (folder / "others.py").write_text(OTHERS)
    words = ("run", path, "--in-process", "--json", "--record")
    done = summary(here(folder, *words, "run.mcap", "--record-topics", "all"))
    here(folder, *words, "deaf.mcap")
    return folder, done


def swapped(folder, what, *words, record="run.mcap"):
    done = here(folder, "swap", record, what, "--json", *words)
    return done.returncode, json.loads(done.stdout)


@pytest.mark.parametrize(
    "what", ["steps=yard:Steps", "walkers=yard:Walker", "eye=yard:Eye", "water=yard:Water",
             "screen=others:Paper"]
)  # fmt: skip
def test_the_same_again_gives_the_same_run(recorded, what):
    folder, whole = recorded
    code, answer = swapped(folder, what)
    assert code == 0, answer
    assert answer["difference"]["same"]
    assert (answer["digest"], answer["frames"]) == (whole["digest"], 30)


@pytest.mark.parametrize("beside", [True, False])
def test_a_class_is_searched_in_the_current_folder_too(recorded, tmp_path, beside):
    folder, whole = recorded
    if not beside:
        (folder / "elsewhere").mkdir()  # a folder of data, which Python takes for a package
        (tmp_path / "elsewhere.py").write_text("from yard import Steps\n")
    where, module = (folder, "yard") if beside else (tmp_path, "elsewhere")
    done = here(where, "swap", folder / "run.mcap", f"steps={module}:Steps", "--json")
    assert done.returncode == 0, done.stderr
    assert json.loads(done.stdout)["digest"] == whole["digest"]


def test_another_view_sees_what_happened(recorded):
    _, answer = swapped(recorded[0], "screen=others:Paper")
    assert answer["figures"] == {"sheets": 31, "figures": 6}


def test_other_agents_live_through_the_same_events(recorded):
    folder, whole = recorded
    code, answer = swapped(folder, "walkers=others:Lame")
    assert code == 1
    assert answer["difference"]["frame"] == 4
    assert {change["attribute"] for change in answer["difference"]["changes"]} == {"x"}
    assert answer["digest"] != whole["digest"]


def test_emitted_events_are_not_sent_again(recorded):
    folder, _ = recorded
    swapped(folder, "walkers=others:Mute", "--record", "mute.mcap")
    counts = [
        json.loads(here(folder, "info", name, "--json").stdout)["events"]
        for name in ("run.mcap", "mute.mcap")
    ]
    assert "eCall" in counts[0]
    assert "eCall" not in counts[1]


def test_another_generator_with_options_recorded_and_compared(recorded):
    folder, _ = recorded
    done = here(folder, "swap", "run.mcap", "steps=others:Slow", "--stride", 3,
                "--record", "slow.mcap")  # fmt: skip
    assert done.returncode == 1, done.stderr
    assert "events of this run alone:\n    eStep<count=0>" in done.stdout
    assert "the frames are over: 30 frames of 30, digest" in done.stdout
    compared = here(folder, "diff", "run.mcap", "slow.mcap")
    assert compared.returncode == 1
    assert "frame 0 is the first that differs" in compared.stdout
    info = json.loads(here(folder, "info", "slow.mcap", "--check", "--json").stdout)
    assert info["digest"] in done.stdout
    assert info["events"]["eStep"] == 30


def test_subscribers_receive_recorded_readings(recorded):
    folder, _ = recorded
    code, answer = swapped(folder, "eye=others:Deaf")
    assert code == 1
    assert answer["difference"]["events"] == {"a": ["eSeen<ripples=0>"], "b": []}


@pytest.mark.parametrize(
    ("words", "problem"),
    [
        (("run.mcap", "steps"), "expected MEMBER=SPEC"),
        (
            ("run.mcap", "stepz=yard:Steps"),
            "has no process 'stepz'; did you mean 'steps'?",
        ),
        (("run.mcap", "steps=yard:Stepz"), "yard has no Stepz"),
        (("run.mcap", "steps=nothing"), "no service 'nothing' is installed"),
        (("run.mcap", "steps=yard:Steps", "--pace", 3), "no option 'pace'"),
        (("run.mcap", "walkers=yard:Walker", "--pace", 3), "agents, which have no opt"),
        (("run.mcap", "walkers=yard:Fragile"), "runs AWalker, not AFragile"),
        (("run.mcap", "steps=others:Free"), "runs freely, by the clock"),
        (("deaf.mcap", "eye=yard:Eye"), "listens to 'sight', which is not in the record"),
        (("run.mcap", "eye=yard:Eye", "--record", "run.mcap"), "name another file"),
        (
            ("run.mcap", "eye=yard:Eye", "--record", "run.txt"),
            "record: cannot write run.txt: expected a name that ends in .mcap",
        ),
    ],
)
def test_an_invalid_swap_is_reported_in_one_line(recorded, words, problem):
    done = here(recorded[0], "swap", *words)
    assert done.returncode == 2
    assert problem in done.stderr
    assert len(done.stderr.splitlines()) == 1


def test_the_member_of_failing_code_is_named(recorded):
    done = here(recorded[0], "swap", "run.mcap", "steps=others:Broken")
    assert done.returncode == 1
    assert done.stderr == "minerva: frame 0: Broken.generate: ZeroDivisionError: its own fault\n"


PANEL = """
from minerva_bus import Agent, EventType, Generator, Vocabulary, on

eHonk = EventType("eHonk", loud=float)

class Car(Agent, symbol="ACar"):
    heard: float = 0.0

    @on("eHonk")
    def hear(self, honk, moment):
        self.heard += honk.loud

class Panel(Generator, events=("eHonk",)):
    people = True

    def __init__(self, frame: int = 5):
        self.frame = frame

    def generate(self, tick):
        return eHonk(9) if tick.number == self.frame else None

vocabulary = Vocabulary.of(eHonk, Car)
"""

QUIET = """
[world]
string = "ACar#a"
vocabulary = "panel:vocabulary"
frames = 10

[process.cars]
agents = "panel:Car"

[process.panel]
service = "panel:Panel"

[norm.quiet]
applies = "people"
on = "eHonk"
when = "event.loud > 2"
"""


def test_norms_for_people_apply_to_a_new_panel_in_any_frame(tmp_path):
    """Also in a frame in which the recorded panel sent nothing."""
    (tmp_path / "panel.py").write_text(PANEL)
    (tmp_path / "quiet.toml").write_text(QUIET)
    here(tmp_path, "run", "quiet.toml", "--in-process", "--record", "run.mcap")
    code, answer = swapped(tmp_path, "panel=panel:Panel", "--frame", "3")
    assert code == 0, answer
    assert answer["difference"]["same"]
    assert answer["figures"] == {"norm_quiet": 1}


@pytest.fixture(scope="module")
def shared(tmp_path_factory):
    """A recorded world in which two members generate events of the same type."""
    folder = tmp_path_factory.mktemp("shared")
    members = LOCKSTEP + '\n[process.fast]\nservice = "others:Slow"\nstride = 1000\n'
    path = write_world(folder, members, frames=8)
    (folder / "others.py").write_text(OTHERS)
    words = ("run", path, "--in-process", "--json", "--record", "run.mcap")
    return folder, summary(here(folder, *words))


def test_inputs_name_the_sender_of_an_event(shared):
    folder, _ = shared
    with Record(folder / "run.mcap") as record:
        cursor = Cursor(record, inputs=True)
        while cursor.ahead is not None:
            ticked = cursor.ahead.inputs.ticked
            number = cursor.ahead.number
            assert [e.count for e in ticked["fast"].events] == [1000 * number]
            fed = Without(frozenset({"fast"})).inputs(cursor.ahead)
            assert "steps" in fed.ticked
            assert "fast" not in fed.ticked
            assert not fed.replies
            cursor.advance()


@pytest.mark.parametrize("what", ["steps=yard:Steps", "fast=others:Slow"])
def test_one_of_two_members_that_make_the_same_events_is_swapped(shared, what):
    folder, whole = shared
    options = ("--stride", 1000) if what.startswith("fast") else ()
    code, result = swapped(folder, what, *options)
    assert code == 0, result
    assert result["digest"] == whole["digest"]


def test_another_member_makes_the_difference_alone(shared):
    code, result = swapped(shared[0], "fast=others:Slow", "--stride", 7)
    assert code == 1
    assert result["difference"]["frame"] == 1
    assert json.dumps(result["difference"]["events"]).count("eStep") == 2


# --- the function ---


class Heavy(Agent, symbol="AFrog"):
    """Grows where other frogs age."""

    x: float = 0.0
    size: float = 1.0
    age: int = 0
    hungry: bool = True
    mood: str = "calm"

    @on("eTick")
    def live(self, tick, moment):
        self.size += 1.0


class Pulse(Generator, events=("eTick",)):
    """Ticks in some frames only."""

    def __init__(self, every: int = 1):
        self.every = every

    def generate(self, tick):
        return () if tick.number % self.every else (eTick(),)


@pytest.fixture(scope="module")
def frogs(tmp_path_factory):
    """A folder with the world file of a pond and its record, of 10 frames."""
    folder = tmp_path_factory.mktemp("frogs")
    pond().save(folder / "pond.toml")
    record(folder / "pond.toml", folder / "run.mcap", frames=10, seed=5)
    return folder


@pytest.mark.parametrize(("member", "replacement", "options"), [
    ("agents", Heavy, {}),
    ("agents", Frog, {}),
    ("eTick", Pulse, {"every": 3}),
])  # fmt: skip
def test_the_function_gives_the_run_of_the_command(frogs, tmp_path, member, replacement, options):
    path = frogs / "run.mcap"
    steps: list[int] = []
    done = replay_swapped(
        path, member, replacement, options=options, into=tmp_path / "own.mcap",
        progress=lambda frame, total: steps.append(frame),
    )  # fmt: skip
    spec = f"{member}={replacement.__module__}:{replacement.__name__}"
    words = [word for name, value in options.items() for word in (f"--{name}", value)]
    command = here(frogs, "swap", path, spec, *words, "--json")
    assert json.loads(command.stdout) == done.plain()
    assert done.difference.same == (replacement is Frog)
    assert steps == [*range(1, 11)]
    assert replay_swapped(path, member, spec.partition("=")[2], options=options) == done


class Eared(Frog, symbol="AFrog"):
    """Responds to an event that no agent of the record responds to."""

    @on("eCroak")
    def hear(self, croak, moment):
        self.hungry = False


def test_agents_may_respond_to_other_events_than_those_recorded(frogs, tmp_path):
    path = tmp_path / "eared.mcap"
    done = replay_swapped(frogs / "run.mcap", "agents", Eared, into=path)
    assert {change.attribute for change in done.difference.changes} == {"hungry"}
    assert replay_swapped(path, "agents", Eared, frogs / "pond.toml").difference.same


def test_a_replacement_that_cannot_be_used_is_named(frogs):
    path = frogs / "run.mcap"
    with pytest.raises(MisuseError, match="no process 'agent'; did you mean 'agents'"):
        replay_swapped(path, "agent", Heavy)
    with pytest.raises(MisuseError, match="Heavy names agents, which have no options"):
        replay_swapped(path, "agents", Heavy, options={"every": 2})
    with pytest.raises(WorldFileError, match="every must be"):
        replay_swapped(path, "eTick", Pulse, options={"every": "often"})
    number: Any = int
    with pytest.raises(MisuseError, match="<class 'int'> is not a class of agents"):
        replay_swapped(path, "agents", number)
