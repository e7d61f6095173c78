"""`check` compares options of services, `[placement]`, conditions and topics with the world."""

import pytest

from minerva_bus import check
from minerva_bus.errors import WorldFileError
from minerva_bus.files import read_text
from minerva_bus.launch import installed
from tests.runtime.running import here

CODE = """\
from minerva_bus import Agent, Device, Disc, EventType, Generator, Primitive, Vocabulary, on

eHonk = EventType("eHonk", loud=float)
eHush = EventType("eHush")
ePicture = EventType("ePicture", visual=True)
PHorn = Primitive("PHorn", Disc(0.1, heading=True))


class Car(Agent, symbol="ACar"):
    heard: float = 0.0

    @on("eHonk")
    def hear(self, honk, moment):
        self.heard += honk.loud


class Loud(Generator, events=("eHonk",)):
    def joined(self, world):
        raise AssertionError("its `joined` may have effects")


class Listener(Generator):
    topics = ("horn",)


class Window(Device, draws=("ePicture",)):
    topics = ("scan",)

    def show(self, view):
        pass


class Film(Window, coupled=True):
    pass


class Horn(Generator):
    def __init__(self, topic: str = "horn") -> None:
        self.publishes = (topic,)


vocabulary = Vocabulary.of(eHonk, eHush, ePicture, PHorn, Car)
"""
WORLD = """\
[world]
string = "ACar#a · ACar#b"
vocabulary = "hall:vocabulary"
frames = 5

[process.cars]
agents = "hall:Car"
processes = 2
"""
MQTT = "service = 'mqtt'\nbroker = 'mqtt://localhost'\ntopics = "


def world(folder, more):
    (folder / "hall.py").write_text(CODE)
    path = folder / "hall.toml"
    path.write_text(WORLD + more)
    return path


@pytest.mark.parametrize(
    ("service", "problem"),
    [
        ('service = "each"\nevent = "eHonk"', "each: eHonk needs loud (real)"),
        ('service = "each"\nevent = "eHank"', "eHank; did you mean 'eHonk'?"),
        ('service = "orders"\nevent = "eHonk"\nfirst = { lowd = 1.0 }', "did you mean 'loud'?"),
        (
            'service = "recorded"\nevents = "eHonk"\nfile = "missing.mcap"',
            "missing.mcap: No such file or directory",
        ),
        ('service = "laser"\nevent = "eHonk"', "laser: eHonk has no dist"),
        ("service = 'camera'\nevent = 'eHonk'", "camera: eHonk has no marker"),
        ('service = "collisions"\ndraws = "ePicture"\nevent = "eHonk"\nwho = "hw"', "who is 'hw'"),
        ('service = "sound"\nvoice = "PHron"', "no such primitive; did you mean 'PHorn'?"),
        ('service = "sound"\nvoice = "PHorn#a"', "PHorn has no parameter `name`"),
        ('service = "keyboard"\nkeymap = { k = "eHonk lowd=1" }\nslide = ""', "no lowd"),
        ('service = "keyboard"\nkeymap = { k = "eHank" }\nslide = ""', "did you mean 'eHonk'?"),
        ('service = "keyboard"\nslide = "eHush"', "eHush must have one real number"),
        (f'{MQTT}{{ t = {{ event = "eHonk", if = "loud == true" }} }}', "loud of a message for"),
        (f'{MQTT}{{ t = {{ event = "eHonk", if = "#a.heard > 1" }} }}', "has no #a.heard"),
        (f'{MQTT}{{ t = {{ event = "eHonk", condition = "herd > 1" }} }}', "mean 'heard'?"),
        (f'{MQTT}{{ t = {{ event = "eHonk", data = {{ lowd = "x" }} }} }}', "eHonk has no lowd"),
    ],
)
def test_options_that_do_not_fit_the_world_are_reported(service, problem, tmp_path):
    path = world(tmp_path, f"[process.source]\n{service}\n")
    with pytest.raises(WorldFileError) as caught:
        check(path)
    assert problem in str(caught.value)
    assert str(caught.value).startswith(f"{path}: [process.source]: ")


@pytest.mark.parametrize(
    ("more", "warnings"),
    [
        ("", ["listener: no process publishes the topic 'horn'; it has"]),
        ("[process.horn]\nservice = 'hall:Horn'\n[process.window]\nservice = 'hall:Window'\n"
         "[process.film]\nservice = 'hall:Film'\n", []),
        ("[process.horn]\nservice = 'hall:Horn'\ntopic = 'hoorn'\n",
         ["listener: no process publishes the topic 'horn'; did you mean 'hoorn'?; it has"]),
        ("[process.horn]\ncommand = 'true'\n", []),
        ("[process.horn]\nservice = 'hall:Horn'\n[world.record]\nfile = 'r.mcap'\n"
         "topics = ['horn', 'scan']\n", ["record: no process publishes the topic 'scan'; it has"]),
        ("[process.horn]\nservice = 'hall:Horn'\n[world.record]\nfile = 'r.mcap'\n"
         "topics = '*'\n", []),
    ],
)  # fmt: skip
def test_topics_that_no_process_publishes_are_warned_of(more, warnings, tmp_path):
    path = world(tmp_path, f"[process.listener]\nservice = 'hall:Listener'\n{more}")
    found = check(path).warnings
    assert [warning.partition(" no readings")[0] for warning in found] == warnings


@pytest.mark.parametrize(
    ("source", "warned"),
    [
        ("service = 'nmea'\nrobot = 'bb'", ["bb, which its options name; did you mean 'b'?"]),
        ("service = 'nmea'\nrobot = 'b'\nspeaks_for = ['#b', 'ACar']", []),
        ("service = 'keyboard'\nslide = ''\nkeymap = {}\nto = 'a, q'\nspeaks_for = ['#r9']",
         ["q, which its options name", "r9, which its options name"]),
    ],
)  # fmt: skip
def test_agents_that_the_string_lacks_are_warned_of(source, warned, tmp_path):
    found = check(world(tmp_path, f"[process.source]\n{source}\n")).warnings
    start = "source: the string has no agent #"
    about = [warning.removeprefix(start) for warning in found if warning.startswith(start)]
    assert [line.partition("; it")[0] for line in about] == warned


def test_no_service_joins_a_world_that_is_checked(tmp_path):
    check(world(tmp_path, '[process.source]\nservice = "hall:Loud"\n'))


@pytest.mark.parametrize(
    ("more", "warnings"),
    [
        ("", ["source: no agent of this world responds to eHush"]),
        ("[norm.quiet]\non = 'eHush'\n", []),
    ],
)
def test_events_to_which_no_agent_responds_are_warned_of(more, warnings, tmp_path):
    service = "[process.source]\nservice = 'each'\nevent = 'eHush'\n"
    found = check(world(tmp_path, f"{service}{more}")).warnings
    assert [warning.partition(", so")[0] for warning in found] == warnings


@pytest.mark.parametrize(
    ("rule", "warning"),
    [
        ('"car-1"', "the name 'car-1'; did you mean 'cars-1'?"),
        ('["gpu-*", "tpu"]', "the name 'gpu-*' or 'tpu'; there are cars-1, cars-2"),
        ('{ near = "camera" }', "near: there is no process 'camera'; there are cars-1, cars-2"),
        ('{ only = ["x"], near = "cars-1" }', "the name 'x'; there are"),
        ('"cars-*"', ""),
        ('{ only = ["cars-2"], near = "cars-1" }', ""),
    ],
)
def test_placement_that_no_process_of_the_file_fits_is_warned_of(rule, warning, tmp_path):
    path = world(tmp_path, f"[placement]\nACar = {rule}\n")
    warnings = check(path).warnings
    assert len(warnings) == bool(warning)
    for text in warnings:
        assert text.startswith("placement.ACar: ")
        assert warning in text


def test_a_program_may_have_any_agents(tmp_path):
    more = '[process.host]\ncommand = ["true"]\n[placement]\nACar = "host"\n'
    assert check(world(tmp_path, more)).warnings == []


def test_a_run_prints_the_warning(tmp_path):
    path = world(tmp_path, '[placement]\nACar = "nowhere"\n')
    done = here(tmp_path, "run", path.name, "--in-process", "--frames", "2")
    assert "placement.ACar: no process that may have such agents" in done.stderr


def test_a_world_file_is_read_once(tmp_path, monkeypatch):
    file, reads = world(tmp_path, ""), []

    def counted(path, *rest):
        reads.append(path)
        return read_text(path, *rest)

    monkeypatch.setattr(installed, "read_text", counted)
    check(file)
    assert reads == [file.resolve()]
