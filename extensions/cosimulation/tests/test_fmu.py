"""An FMU in a world: a room of FMI 3, heated by an agent."""

import gc
import os
import platform
import shutil
import subprocess
import sys
import tempfile
import textwrap
import zipfile
from pathlib import Path

import pytest

pytest.importorskip("fmpy", reason="needs FMPy (pip install 'minerva-bus[fmi]')")
pytest.importorskip("pythonfmu3", reason="needs pythonfmu3 (pip install 'minerva-bus[fmi]')")
from pythonfmu3 import FmuBuilder

from minerva_bus import Agent, EventType, MinervaError, Primitive, World, on, run, service, view
from minerva_cosimulation.fmu_service import Fmu
from minerva_cosimulation.fmu_service.model import FmuModel

eCelsius = EventType("eCelsius", celsius=float, steps=int)
eControl = EventType("eControl", visual=True)
PHeater = Primitive("PHeater", watts=float, plan=str, huge=float)

ROOM = """
    import numpy
    from pythonfmu3 import Dimension, Fmi3Causality, Fmi3Slave, Fmi3Variability, Float64, Int64
    from pythonfmu3.fmi3slave import Fmi3StepResult

    class Room(Fmi3Slave):
        def __init__(self, **arguments):
            super().__init__(**arguments)
            self.time, self.celsius, self.watts, self.capacity, self.steps = 0.0, 18.0, 0.0, 2000.0, 0
            self.walls = numpy.array([1.0, 2.0])
            kinds = {
                "time": Fmi3Causality.independent,
                "celsius": Fmi3Causality.output,
                "watts": Fmi3Causality.input,
                "capacity": Fmi3Causality.input,
            }
            for name, causality in kinds.items():
                self.register_variable(Float64(name, causality=causality))
            walls = {"causality": Fmi3Causality.input, "dimensions": [Dimension(start="2")]}
            self.register_variable(Float64("walls", **walls))
            discrete = Fmi3Variability.discrete
            self.register_variable(
                Int64("steps", causality=Fmi3Causality.output, variability=discrete)
            )

        def do_step(self, time, duration):
            self.steps += 1
            if self.celsius < -273.15:
                raise ValueError("below absolute zero")
            heating = self.watts / self.capacity - 0.02 * (self.celsius - 5)
            self.celsius += duration * heating
            return Fmi3StepResult(terminateSimulation=self.celsius > 99)
"""


class Thermostat(Agent, symbol="AThermostat"):
    watts: float = 0.0
    celsius: float = 0.0
    steps: int = 0

    @on("eCelsius")
    def switch(self, room, moment):
        self.celsius, self.steps = room.celsius, room.steps
        if not 20 <= room.celsius <= 21:
            self.watts = 1000.0 if room.celsius < 20 else 0.0

    @view("eControl")
    def control(self, event):
        return PHeater(self.watts, "x", 1e21)


@pytest.fixture(scope="module")
def room(tmp_path_factory):
    script = tmp_path_factory.mktemp("fmu") / "room.py"
    script.write_text(textwrap.dedent(ROOM))
    return str(FmuBuilder.build_FMU(script, dest=script.parent))


OPTIONS = {
    "event": "eCelsius",
    "outputs": "celsius=celsius, steps=steps",
    "inputs": "watts=PHeater.watts",
    "draws": "eControl",
}


def world(room, string="AThermostat#t", **options):
    return World(
        string,
        agents=[Thermostat],
        services=[service(Fmu, path=room, **OPTIONS | options)],
        symbols=[PHeater, eControl, eCelsius],
        name="heated",
        dt=0.5,
    )


def test_the_room_is_heated_as_in_a_loop_by_hand(room):
    done = run(world(room), frames=60, collect={"celsius": Thermostat.celsius})
    celsius, expected = 18.0, [0.0]
    # The heater's power in the string before each frame. The view of a frame shows the string before
    # it, and acts in the step of the following frame.
    watts = [0.0]
    for frame in range(60):
        acting = watts[frame - 1] if frame else 0.0
        celsius += 0.5 * (acting / 2000.0 - 0.02 * (celsius - 5))
        expected.append(celsius)
        kept = 20 <= celsius <= 21
        watts.append(watts[-1] if kept else 1000.0 if celsius < 20 else 0.0)
    assert list(done.table("AThermostat")["celsius"]) == expected
    assert done.digest == run(world(room), frames=60).digest


def test_starts_are_set_before_the_first_step(room):
    done = run(world(room, starts="celsius=18.0, capacity=4000"), frames=3)
    assert "steps=3" in str(done.scene)


def test_the_values_of_an_array_are_a_list(room):
    model = FmuModel(Path(room), {})
    assert model.get("walls") == [1.0, 2.0]
    for value in (5.0, (5.0,)):
        with pytest.raises(MinervaError, match="walls is an array of 2 Float64"):
            model.set("walls", value)
    with pytest.raises(MinervaError, match=r"steps is Int64, not 1\.5"):
        model.set("steps", 1.5)
    model.close()


def test_a_model_that_ends_the_simulation_makes_its_last_step(room):
    hot = world(room, starts="celsius=100")
    assert "celsius=99.05" in str(run(hot, frames=1).scene)
    with pytest.raises(MinervaError, match=r"ended the simulation in its step to 0\.5 s"):
        run(hot, frames=2)


HEATED = """
#include <stdlib.h>
typedef struct { double celsius; int steps; } Room;
void *fmi2Instantiate(char *n, int t, char *g, char *r, void *c, int v, int l) {
    return calloc(1, sizeof(Room));
}
void fmi2FreeInstance(void *c) { free(c); }
int fmi2SetReal(void *c, unsigned *r, size_t n, double *x) { ((Room *)c)->celsius = *x; return 0; }
int fmi2GetReal(void *c, unsigned *r, size_t n, double *x) { *x = ((Room *)c)->celsius; return 0; }
int fmi2GetInteger(void *c, unsigned *r, size_t n, int *x) { *x = ((Room *)c)->steps; return 0; }
int fmi2DoStep(void *c, double t, double d, int s) {
    ((Room *)c)->celsius += d;
    return ++((Room *)c)->steps == 4 ? 2 : 0;
}
int fmi2GetBooleanStatus(void *c, int kind, int *x) { *x = kind == 3; return 0; }
"""
SUCCEEDING = (
    "GetVersion GetTypesPlatform SetDebugLogging SetupExperiment EnterInitializationMode"
    " ExitInitializationMode Terminate Reset GetBoolean GetString SetInteger SetBoolean SetString"
    " GetFMUstate SetFMUstate FreeFMUstate SerializedFMUstateSize SerializeFMUstate"
    " DeSerializeFMUstate GetDirectionalDerivative SetRealInputDerivatives"
    " GetRealOutputDerivatives CancelStep GetStatus GetRealStatus GetIntegerStatus GetStringStatus"
)
DESCRIBED = """<fmiModelDescription fmiVersion="2.0" modelName="heated" guid="g">
<CoSimulation modelIdentifier="heated"/><ModelVariables>
<ScalarVariable name="celsius" valueReference="0" causality="output" initial="exact">
<Real start="0"/></ScalarVariable>
<ScalarVariable name="steps" valueReference="1" causality="output" variability="discrete"
initial="exact"><Integer start="0"/></ScalarVariable></ModelVariables>
<ModelStructure><Outputs><Unknown index="1"/><Unknown index="2"/></Outputs></ModelStructure>
</fmiModelDescription>"""


@pytest.mark.skipif(
    not shutil.which("cc") or platform.machine() != "x86_64", reason="builds a model in C"
)
def test_a_model_of_fmi_2_takes_part(tmp_path):
    further = [f"int fmi2{name}() {{ return 0; }}" for name in SUCCEEDING.split()]
    (tmp_path / "heated.c").write_text("\n".join([HEATED, *further]))
    library, fmu = tmp_path / "heated.so", tmp_path / "heated.fmu"
    command = ["cc", "-w", "-shared", "-fPIC", "-o", library, tmp_path / "heated.c"]
    subprocess.run(command, check=True)
    with zipfile.ZipFile(fmu, "w") as file:
        file.writestr("modelDescription.xml", DESCRIBED)
        file.write(library, "binaries/linux64/heated.so")
    heated = world(str(fmu), inputs="", draws="", starts="celsius=20")
    done = run(heated, frames=4)
    assert "celsius=22, steps=4" in str(done.scene)
    with pytest.raises(MinervaError, match=r"ended the simulation in its step to 2 s"):
        run(heated, frames=5)


@pytest.mark.parametrize(
    ("options", "problem"),
    [
        ({"outputs": "celsius=celsus"}, "no variable 'celsus'; did you mean 'celsius'"),
        ({"inputs": "wats=PHeater.watts"}, "no variable 'wats'"),
        ({"inputs": "watts=PHeater"}, "expected PRIMITIVE.PARAMETER"),
        ({"outputs": "celsius"}, "expected NAME=VALUE"),
        ({"inputs": "watts=PHeater.wats"}, "PHeater has no wats; did you mean 'watts'"),
        ({"inputs": "watts=PHeeter.watts"}, "no primitive PHeeter; did you mean 'PHeater'"),
        ({"inputs": "steps=PHeater.plan"}, "steps is Int64, not 'x'"),
        (
            {"inputs": "steps=PHeater.huge"},
            "steps is Int64, which cannot be 1000000000000000000000",
        ),
        ({"starts": "capacity=much"}, "capacity is 'much'; expected a number"),
        ({"starts": "capacity=nan"}, "capacity is 'nan'; expected a number"),
        ({"draws": ""}, "inputs need draws"),
        ({"path": "missing.fmu"}, "missing.fmu"),
    ],
)
def test_mistakes_are_explained(room, options, problem, tmp_path, monkeypatch):
    monkeypatch.setattr(tempfile, "tempdir", str(tmp_path))
    with pytest.raises(MinervaError, match=problem):
        run(world(room=options.pop("path", room), **options), frames=2)
    assert not list(tmp_path.iterdir())  # The extracted files are removed.


def test_files_that_are_no_models_are_one_line(tmp_path, monkeypatch):
    wrong = '<Float64 name="a" valueReference="x"/>' * 50
    with zipfile.ZipFile(tmp_path / "wrong.fmu", "w") as file:
        file.writestr(
            "modelDescription.xml",
            '<fmiModelDescription fmiVersion="3.0"><ModelVariables>'
            f"{wrong}</ModelVariables></fmiModelDescription>",
        )
    os.mkfifo(tmp_path / "pipe.fmu")
    for name, problem in (("wrong", "Failed to validate"), ("pipe", "is a pipe or device")):
        with pytest.raises(MinervaError, match=problem) as caught:
            run(world(str(tmp_path / f"{name}.fmu")), frames=1)
        assert "\n" not in str(caught.value)
    monkeypatch.setattr("minerva_cosimulation.fmu_service.model.MAX_EXTRACTED", 1_000)
    with pytest.raises(MinervaError, match=r"unpacks to 1,[0-9]* bytes; expected at most 1,000"):
        run(world(str(tmp_path / "wrong.fmu")), frames=1)


def test_a_model_that_fails_ends_the_world_and_nothing_else(room):
    """After a fatal status nothing of the FMU may be called, or the collector finds broken memory."""
    for _ in range(3):
        with pytest.raises(MinervaError, match="fatal"):
            run(world(room, starts="celsius=-300"), frames=3)
        gc.collect()


def test_a_process_with_helics_is_refused(room, monkeypatch):
    monkeypatch.setitem(sys.modules, "helics", gc)
    with pytest.raises(MinervaError, match="HELICS is loaded in this process"):
        run(world(room), frames=1)


def test_two_heaters_for_one_variable_are_an_error(room):
    with pytest.raises(MinervaError, match="2 figures PHeater in frame 0"):
        run(world(room, "AThermostat#a · AThermostat#b"), frames=2)
