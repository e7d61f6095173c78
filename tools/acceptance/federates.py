"""HELICS: a world in place of a federate of an example, beside the results of the example.

python -m tools.acceptance.federates world battery FOLDER    # a world as a federate
python -m tools.acceptance.federates script FILE RESULTS     # a federate of the example
python -m tools.acceptance.federates broker                  # until both have left
"""

from __future__ import annotations

import json
import os
import runpy
import subprocess
import sys
import time
from collections.abc import Iterator, Mapping
from importlib.util import find_spec
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any
from unittest.mock import MagicMock

import numpy as np

from minerva_bus import Agent, EventType, World, on
from tools.acceptance.suite import MissingSuiteError, Outcome, Result, Suite, judged

CARS = range(1, 6)
PERIOD, END = 60.0, 7 * 24 * 3600.0
"""Step and end of the example, seconds."""
SECONDS = 300.0

ENDPOINTS = "its federates send messages to endpoints; a world has values, which are its attributes"

VOLTAGE = EventType("eVoltage", volts=float)
CURRENT = EventType("eCurrent", amperes=float)


class Battery(Agent, symbol="ABattery"):
    """A car's battery, by the formulas of the example."""

    soc: float = 0.0
    rating: float = 0.0
    current: float = 0.0

    @on("eVoltage")
    def charge(self, voltage: Any, moment: Any) -> None:
        """Charge for a step."""
        self.current = 0.0 if self.soc >= 1 else voltage.volts / (8.0 + 142.0 * self.soc)
        self.soc += self.current * voltage.volts * PERIOD / 3600 / 1000 / self.rating


class Charger(Agent, symbol="ACharger"):
    """A charging point of constant voltage."""

    voltage: float = 0.0
    current: float = 0.0

    @on("eCurrent")
    def measure(self, current: Any, moment: Any) -> None:
        """Keep what the car draws."""
        self.current = current.amperes


def _script(path: Path, name: str) -> dict[str, Any]:
    """The names in a script of the example after it has run, without its pictures."""
    pictures = MagicMock()
    pictures.pyplot.subplots.return_value = MagicMock(), MagicMock()
    sys.modules |= {"matplotlib": pictures, "matplotlib.pyplot": pictures.pyplot}
    return runpy.run_path(str(path), run_name=name)


def _batteries(folder: Path) -> World:
    """Cars as in the example's Battery.py."""
    np.random.seed(628)
    ratings = _script(folder / "Battery.py", "Battery")["get_new_battery"](len(CARS))
    charges = [np.random.randint(0, 60) / 100 for _ in CARS]
    cars = zip(CARS, charges, ratings, strict=True)
    text = " · ".join(f"ABattery#ev{n}<soc={soc}, rating={size}>" for n, soc, size in cars)
    return World(text, agents=[Battery], symbols=[VOLTAGE], name="batteries")


def _chargers(folder: Path) -> World:
    """Charging points as in the example's Charger.py."""
    np.random.seed(1490)
    names = _script(folder / "Charger.py", "Charger")
    voltages = names["calc_charging_voltage"](names["get_new_EV"](len(CARS))[-1])
    points = zip(CARS, voltages, strict=True)
    text = " · ".join(f"ACharger#ev{number}<voltage={volts}>" for number, volts in points)
    return World(text, agents=[Charger], symbols=[CURRENT], name="chargers")


def _config(name: str, output: str, datum: str, source: str) -> Mapping[str, Any]:
    """The federate of the example, with the names of a world, and its own as aliases."""
    kind = output.partition("_")[2]
    return {
        "name": name,
        "core_type": "zmq",
        "period": PERIOD,
        "wait_for_current_time_update": name == "Battery",
        "publications": [{"key": f"ev{car}.{kind}", "type": "double"} for car in CARS],
        "inputs": [
            {"key": f"ev{car}.{datum}", "type": "double", "targets": [source.format(car)]}
            for car in CARS
        ],
        "aliases": [[f"{name}/ev{car}.{kind}", output.format(car)] for car in CARS],
    }


def _take_part(role: str, folder: Path) -> None:
    from minerva_cosimulation.helics import WorldFederate

    current, voltage = "Battery/EV{}_current", "Charger/EV{}_voltage"
    if role == "battery":
        world = _batteries(folder)
        config = _config("Battery", current, "eVoltage.volts", voltage)
    else:
        world = _chargers(folder)
        config = _config("Charger", voltage, "eCurrent.amperes", current)
    with TemporaryDirectory(prefix="minerva-acceptance-") as place:
        file = Path(place, f"{role}.json")
        file.write_text(json.dumps(config), encoding="utf-8")
        print(WorldFederate(world, file).run(until=END))


def _run_script(path: Path, results: Path) -> None:
    os.chdir(path.parent)  # It reads its configuration there.
    names = _script(path, "__main__")
    series = [names["power"]] if "power" in names else [*names["soc"].values()]
    results.write_text(json.dumps(series), encoding="utf-8")


def _broker() -> None:
    import helics

    broker = helics.helicsCreateBroker("zmq", "", "--federates 2")
    while helics.helicsBrokerIsConnected(broker):
        time.sleep(0.1)


def _federation(folder: Path, results: Path, worlds: str = "") -> dict[str, Any]:
    """The results of the scripts by name, with a world in place of that of this role."""
    scripts = [role for role in ("battery", "charger") if role != worlds]
    for role in scripts:
        (results / role).unlink(missing_ok=True)
    commands = [["broker"]]
    commands += [
        ["script", str(folder / f"{role.title()}.py"), str(results / role)] for role in scripts
    ]
    commands += [["world", worlds, str(folder)]] if worlds else []
    processes = [
        subprocess.Popen(
            [sys.executable, "-m", __name__, *command],
            cwd=Path(__file__).resolve().parents[2],
            stdout=subprocess.DEVNULL,
        )
        for command in commands
    ]
    try:
        for process in processes:
            process.wait(SECONDS)
    finally:
        for process in processes:
            process.kill()
            process.wait()
    written = [role for role in scripts if (results / role).exists()]
    return {role: json.loads((results / role).read_text(encoding="utf-8")) for role in written}


def _problems(series: list[list[float]], theirs: list[list[float]]) -> Iterator[str]:
    if not series or len(series) != len(theirs):
        yield "the federation failed; its messages are above"
    for ours, other in zip(series, theirs, strict=False):
        if ours != other:
            pairs = enumerate(zip(ours, other, strict=False))
            step, values = next((n, pair) for n, pair in pairs if pair[0] != pair[1])
            yield f"{values[0]} in step {step}; expected {values[1]}"


def _results(folder: Path) -> Iterator[Result]:
    if not find_spec("helics"):
        raise MissingSuiteError("it needs HELICS: pip install 'minerva-bus[helics]'")
    example = folder / "fundamental_default"
    with TemporaryDirectory(prefix="minerva-acceptance-") as place:
        theirs = _federation(example, Path(place))
        for role, other in (("battery", "charger"), ("charger", "battery")):
            series = _federation(example, Path(place), role).get(other, [])
            problems = _problems(series, theirs.get(other, []))
            yield judged(f"{example.name}, {role} as a world", problems)
    for script in sorted(folder.rglob("Charger.py")):
        if "Endpoint" in script.read_text(encoding="utf-8"):
            yield Result(script.parent.name, Outcome.EXPECTED, ENDPOINTS)


HELICS = Suite(
    "helics",
    "GMLC-TDC/HELICS-Examples",
    "user_guide_examples/fundamental",
    "`WorldFederate`: results of an example in which a world takes the place of a federate",
    _results,
)


def main() -> None:
    """Run the process of a case, as in the docstring of this module."""
    match sys.argv[1:]:
        case ["world", role, folder]:
            _take_part(role, Path(folder))
        case ["script", path, results]:
            _run_script(Path(path), Path(results))
        case _:
            _broker()


if __name__ == "__main__":
    main()
