"""A simulator of mosaik in a world: a room that an agent heats."""

import sys
import threading
from pathlib import Path

import pytest

pytest.importorskip("mosaik", reason="needs the extra mosaik")

from minerva_bus import Agent, EventType, MinervaError, Primitive, World, on, run, service, view
from minerva_cosimulation.mosaik_service import Mosaik

sys.path.insert(0, str(Path(__file__).parents[3] / "examples" / "heating"))
import heating_mosaik
import mosaik_api_v3

EXAMPLES = Path(heating_mosaik.__file__).parent

eCelsius = EventType("eCelsius", celsius=float)
eControl = EventType("eControl", visual=True)
PHeater = Primitive("PHeater", watts=float)
FRAMES = 40
OPTIONS = {
    "simulator": "heating_mosaik:Room",
    "model": "Entity",
    "event": "eCelsius",
    "outputs": "celsius=celsius",
    "inputs": "watts=PHeater.watts",
    "draws": "eControl",
}


class Thermostat(Agent, symbol="AThermostat"):
    watts: float = 0.0
    celsius: float = 0.0

    @on("eCelsius")
    def switch(self, room, moment):
        self.celsius = room.celsius
        if not 20 <= room.celsius <= 21:
            self.watts = 1000.0 if room.celsius < 20 else 0.0

    @view("eControl")
    def control(self, event):
        return PHeater(self.watts)


def world(string="AThermostat#t", **options):
    return World(
        string,
        agents=[Thermostat],
        services=[service(Mosaik, **OPTIONS | options)],
        symbols=[PHeater, eControl, eCelsius],
        name="heated",
    )


@pytest.fixture(scope="module")
def by_hand():
    """The temperatures of a loop without mosaik."""
    room, celsius, watts = heating_mosaik.Room(), [0.0], [0.0]
    for frame in range(FRAMES):
        # The view of a frame shows the string before it, and acts in the step of the next frame.
        room.update(watts[frame - 1] if frame else 0.0)
        celsius.append(room.celsius)
        kept = 20 <= room.celsius <= 21
        watts.append(watts[-1] if kept else 1000.0 if room.celsius < 20 else 0.0)
    return celsius


def test_the_room_is_heated_as_in_a_loop_by_hand(by_hand):
    done = run(world(), frames=FRAMES, collect={"celsius": Thermostat.celsius})
    assert list(done.table("AThermostat")["celsius"]) == by_hand
    assert done.digest == run(world(), frames=FRAMES).digest
    assert not [thread for thread in threading.enumerate() if thread.name == "mosaik"]


class Sampler(mosaik_api_v3.Simulator):
    """Steps every `step_size` units of time; its output is the time of its last step."""

    def __init__(self):
        super().__init__(heating_mosaik.meta("time"))

    def init(self, sid, time_resolution=1.0, step_size=1):
        self.step_size = step_size
        return self.meta

    def create(self, number, model):
        return [{"eid": model, "type": model}]

    def step(self, time, inputs, max_advance):
        self.time = time
        return time + self.step_size

    def get_data(self, outputs):
        return {"Entity": {"time": float(self.time)}}


SAMPLER = {"simulator": f"{__name__}:Sampler", "outputs": "celsius=time", "inputs": "", "draws": ""}


@pytest.mark.parametrize(
    ("step_size", "duration", "times"),
    [(1, 1, [0, 1, 2, 3]), (2, 1, [0, 0, 2, 2]), (1, 3, [2, 5, 8, 11]), (2, 3, [2, 4, 8, 10])],
)
def test_mosaik_controls_when_a_simulator_steps(step_size, duration, times):
    """The outputs of a frame are those of the last step before its end."""
    heated = world(**SAMPLER, settings=f"step_size={step_size}", duration=duration)
    done = run(heated, frames=4, collect={"celsius": Thermostat.celsius})
    assert list(done.table("AThermostat")["celsius"])[1:] == times


PROCESS = """
import sys, time; sys.path.insert(0, {examples!r})
import heating_mosaik, mosaik_api_v3
class Slow(heating_mosaik.Room):
    def update(self, watts):
        print("steps", flush=True)
        time.sleep(600)
mosaik_api_v3.start_simulation({simulator}())
"""


def process(folder, simulator):
    """The command of a simulator that is a process."""
    program = folder / "room.py"
    program.write_text(PROCESS.format(examples=str(EXAMPLES), simulator=simulator))
    return f"{sys.executable} {program} %(addr)s"


def test_a_simulator_may_be_a_process(by_hand, tmp_path):
    room = process(tmp_path, "heating_mosaik.Room")
    done = run(world(simulator=room), frames=FRAMES, collect={"celsius": Thermostat.celsius})
    assert list(done.table("AThermostat")["celsius"]) == by_hand


def test_a_simulator_that_does_not_answer_ends_the_world_and_its_process(tmp_path):
    room = process(tmp_path, "Slow")
    with pytest.raises(MinervaError, match=r"room.py.*the step at time 0 s takes more than 0.2 s"):
        run(world(simulator=room, seconds=0.2), frames=2)
    assert not [thread for thread in threading.enumerate() if thread.name == "mosaik"]
    running = [path.read_bytes() for path in Path("/proc").glob("[0-9]*/cmdline") if path.exists()]
    assert not [line for line in running if str(tmp_path).encode() in line]


@pytest.mark.parametrize(
    ("options", "problem"),
    [
        ({"outputs": "celsius=celsus"}, "mosaik: heating_mosaik:Room: .*celsus"),
        ({"simulator": "heating_mosaik:Rom"}, "mosaik: heating_mosaik:Rom: .*Rom"),
        ({"model": "Rooms"}, "mosaik: heating_mosaik:Room: .*Rooms"),
        ({"inputs": "watts=PHeater"}, "expected PRIMITIVE.PARAMETER"),
        ({"settings": "step_size=1 s"}, "the value of step_size is '1 s'; expected a number"),
        ({"duration": 0}, "duration is 0; expected a whole number from 1"),
        ({"seconds": 0}, "seconds is 0; expected a number above 0"),
        ({"string": "AThermostat#a · AThermostat#b"}, "2 figures PHeater in frame 0"),
    ],
)
def test_mistakes_are_explained(options, problem):
    with pytest.raises(MinervaError, match=problem):
        run(world(**options), frames=3)
