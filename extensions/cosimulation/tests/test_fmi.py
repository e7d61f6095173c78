"""A world as an FMU of FMI 3, which FMPy steps."""

import gc
import textwrap

import numpy as np
import pytest

pytest.importorskip("pythonfmu3", reason="needs pythonfmu3 (pip install 'minerva-bus[fmi]')")
pytest.importorskip("fmpy", reason="needs FMPy (pip install 'minerva-bus[fmi]')")
import fmpy
from fmpy.fmi1 import FMICallException
from fmpy.fmi3 import FMU3Slave
from fmpy.validation import validate_fmu

from minerva_bus import MinervaError
from minerva_cosimulation import SteppedWorld
from minerva_cosimulation.fmi import export_fmu

ROOMS = textwrap.dedent(
    """
    from typing import Annotated

    from minerva_bus import EMPTY, Agent, EventType, Range, Vocabulary, on

    eStep = EventType("eStep")
    eHeat = EventType("eHeat", watts=float, place=str)
    eFan = EventType("eFan", speed=Annotated[int, Range(0, 9)], on=bool)

    class Room(Agent, symbol="ARoom"):
        celsius: float = 18.0
        watts: float = 0.0
        speed: int = 0
        warm: bool = False
        place: str = ""
        past: tuple[float, ...] = ()

        @on("eHeat")
        def heat(self, heat, moment):
            self.watts, self.place = heat.watts, heat.place
            if heat.place == "burn":
                1 / 0
            if heat.place == "leave":
                return EMPTY

        @on("eFan")
        def fan(self, fan, moment):
            self.speed = fan.speed if fan.on else 0

        @on("eStep")
        def cool(self, step, moment):
            self.celsius += self.watts / 2000 - 0.02 * (self.celsius - 5)
            self.warm = self.celsius > 19

    vocabulary = Vocabulary.of(eStep, eHeat, eFan, Room)
    """
)
HOUSE = textwrap.dedent(
    """
    [world]
    vocabulary = "fmu_rooms:vocabulary"
    string = "ARoom#hall"
    dt = 0.5

    [process.clock]
    service = "each"
    event = "eStep"

    [process.rooms]
    agents = "fmu_rooms:Room"
    """
)
INPUTS = ["eHeat.watts", "eHeat.place", "hall.eFan.speed", "hall.eFan.on"]
ERROR = 3
"""The status, as in the standard."""
OUTPUTS = ["hall.celsius", "hall.speed", "hall.warm", "hall.place"]


@pytest.fixture(scope="module")
def house(tmp_path_factory):
    folder = tmp_path_factory.mktemp("house")
    (folder / "fmu_rooms.py").write_text(ROOMS)
    (folder / "house.toml").write_text(HOUSE)
    # Here, because the file of an extracted FMU could otherwise have had its inode.
    (folder / "foreign.fmu").write_bytes(b"someone else's")
    return folder / "house.toml"


@pytest.fixture(scope="module")
def fmu(house):
    return export_fmu(house, house.with_suffix(".fmu"), inputs=INPUTS, outputs=OUTPUTS, seed=3)


@pytest.fixture
def slave(fmu, tmp_path):
    described = fmpy.read_model_description(fmu)
    made = FMU3Slave(
        guid=described.guid,
        unzipDirectory=fmpy.extract(fmu, unzipdir=str(tmp_path / "fmu")),
        modelIdentifier=described.coSimulation.modelIdentifier,
        instanceName="house",
    )
    made.references = {v.name: v.valueReference for v in described.modelVariables}
    made.failed = False
    made.instantiate()
    made.enterInitializationMode()
    made.exitInitializationMode()
    yield made
    if not made.failed:
        made.terminate()
    made.freeInstance()


def test_the_description_is_valid_and_names_the_variables(fmu):
    assert validate_fmu(fmu) == []
    described = fmpy.read_model_description(fmu)
    assert described.fmiVersion == "3.0"
    assert {(v.name, v.type, v.causality) for v in described.modelVariables} == {
        ("time", "Float64", "independent"),
        ("eHeat.watts", "Float64", "input"),
        ("eHeat.place", "String", "input"),
        ("hall.eFan.speed", "Int64", "input"),
        ("hall.eFan.on", "Boolean", "input"),
        ("hall.celsius", "Float64", "output"),
        ("hall.speed", "Int64", "output"),
        ("hall.warm", "Boolean", "output"),
        ("hall.place", "String", "output"),
        ("digest", "String", "output"),
    }


def test_an_importer_steps_the_world_with_the_digest_of_the_world_alone(slave, house):
    at = slave.references
    slave.setFloat64([at["eHeat.watts"]], [1000.0])
    slave.setString([at["eHeat.place"]], ["wall"])
    slave.setInt64([at["hall.eFan.speed"]], [3])
    slave.setBoolean([at["hall.eFan.on"]], [True])
    for step in range(5):
        slave.doStep(step * 1.0, 1.0)
    with SteppedWorld(house, seed=3) as stepped:
        for name, value in zip(INPUTS, (1000.0, "wall", 3, True), strict=True):
            stepped.set(name, value)
        stepped.step(10)
        assert slave.getString([at["digest"]]) == [stepped.digest]
        assert slave.getFloat64([at["hall.celsius"]]) == [stepped.get("hall.celsius")]
    assert slave.getInt64([at["hall.speed"]]) == [3]
    assert slave.getBoolean([at["hall.warm"]]) == [True]


@pytest.mark.parametrize(
    ("deed", "duration", "problem"),
    [
        ("", 0.3, "a step of 0.3 s; expected a multiple of a frame, 0.5 s"),
        ("speed", 0.5, "speed must be a number from 0 to 9, not -1"),
        ("burn", 0.5, "ZeroDivisionError"),
        ("leave", 0.5, "the string has no agent 'hall' in frame 1"),
    ],
)
def test_a_failure_is_an_error_with_a_reason_and_never_fatal(slave, capfd, deed, duration, problem):
    at = slave.references
    if deed == "speed":
        slave.setInt64([at["hall.eFan.speed"]], [-1])
    elif deed:
        slave.setString([at["eHeat.place"]], [deed])
    slave.failed = True
    for _ in range(2):
        with pytest.raises(FMICallException) as caught:
            slave.doStep(0.0, duration)
        assert int(caught.value.status) == ERROR
    assert problem in capfd.readouterr().out
    gc.collect()


def test_fmpy_runs_it_with_its_own_loop(fmu, house):
    events = np.array([(0.0, 400.0), (2.0, 400.0)], dtype=[("time", float), ("eHeat.watts", float)])
    result = fmpy.simulate_fmu(fmu, stop_time=2.0, input=events, output=["hall.celsius"])
    with SteppedWorld(house, seed=3) as stepped:
        celsius = [stepped.get("hall.celsius")]
        for _ in range(4):
            stepped.set("eHeat.watts", 400.0)
            stepped.set("eHeat.place", "")
            stepped.step()
            celsius.append(stepped.get("hall.celsius"))
    assert list(result["time"]) == [0.0, 0.5, 1.0, 1.5, 2.0]
    assert list(result["hall.celsius"]) == celsius


@pytest.mark.parametrize(
    ("path", "variables", "problem"),
    [
        ("house.zip", {}, "expected a name that ends in .fmu"),
        ("my house.fmu", {}, "expected a name such as house.fmu"),
        ("a.fmu", {"outputs": ["hall.past"]}, "list of real; expected a real"),
        ("a.fmu", {"inputs": ["eHeat.wats"]}, "did you mean 'watts'"),
    ],
)
def test_what_cannot_be_exported_is_explained(house, tmp_path, path, variables, problem):
    with pytest.raises(MinervaError, match=problem):
        export_fmu(house, tmp_path / path, **variables)


def test_only_a_file_of_the_program_is_overwritten(house, fmu):
    export_fmu(house, fmu)
    with pytest.raises(MinervaError, match="was not written by Minerva Bus"):
        export_fmu(house, house.with_name("foreign.fmu"))
