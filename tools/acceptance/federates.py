"""HELICS: a world in place of a federate of an example, beside the results of the example.

python -m tools.acceptance.federates world ROLE FOLDER      # a world as a federate
python -m tools.acceptance.federates script FILE RESULTS    # a federate of the example
python -m tools.acceptance.federates broker NUMBER          # until all have left
"""

from __future__ import annotations

import json
import os
import re
import runpy
import shutil
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

from minerva_bus import Agent, EventType, World, each, on
from tools.acceptance.suite import MissingSuiteError, Result, Suite, judged

CARS = range(1, 6)
PERIOD, DAY = 60.0, 24 * 3600.0
"""Step of the examples, seconds."""
SECONDS = 120.0
"""Most that a federation takes; the longest that ends takes a quarter."""

STUCK = "its own federates hang in HELICS, before any world takes part"
WAITS = "wait_for_current_time_update"
"""With this option and an offset, HELICS grants no federate its first time."""

VOLTAGE = EventType("eVoltage", volts=float)
CURRENT = EventType("eCurrent", amperes=float)
TEXTS = [EventType(name, text=str) for name in ("eVolts", "eAmperes")]
BEGIN, CHARGE = EventType("eBegin"), EventType("eCharge", text=str, source=str)
COMMAND = EventType("eCommand", text=str, destination=str)


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


class Cell(Agent, symbol="ACell"):
    """A battery that gets voltages and sends currents as messages."""

    soc: float = 0.0
    rating: float = 0.0

    @on("eVolts")
    def charge(self, message: Any, moment: Any) -> None:
        """Charge for a step, and answer."""
        volts = float(message.text)
        current = 0.0 if self.soc >= 1 else volts / (8.0 + 142.0 * self.soc)
        self.soc += current * volts * PERIOD / 3600 / 1000 / self.rating
        moment.emit(TEXTS[1](str(current)))


class Plug(Agent, symbol="APlug"):
    """A charging point that begins with a message of its voltage, and answers with it."""

    voltage: float = 0.0

    @on("eBegin")
    def begin(self, event: Any, moment: Any) -> None:
        """Send the first message."""
        if moment.number == 0:
            moment.emit(TEXTS[0](str(self.voltage)))

    @on("eAmperes")
    def answer(self, message: Any, moment: Any) -> None:
        """Send the voltage again."""
        moment.emit(TEXTS[0](f"{self.voltage:4f}"))


class Controller(Agent, symbol="AController"):
    """Tells each charging point whether its car still needs charge."""

    @on("eCharge")
    def command(self, charge: Any, moment: Any) -> None:
        """Answer the sender."""
        moment.emit(COMMAND("1" if float(charge.text) <= 0.95 else "0", charge.source))


def _script(path: Path, name: str) -> dict[str, Any]:
    """The names in a script of the example after it has run, without its pictures."""
    pictures = MagicMock()
    pictures.pyplot.subplots.return_value = MagicMock(), MagicMock()
    sys.modules |= {"matplotlib": pictures, "matplotlib.pyplot": pictures.pyplot}
    return runpy.run_path(str(path), run_name=name)


def _batteries(folder: Path, seed: int, kind: str) -> str:
    """The string of cars as in the example's Battery.py."""
    np.random.seed(seed)
    ratings = _script(folder / "Battery.py", "Battery")["get_new_battery"](len(CARS))
    charges = [np.random.randint(0, 60) / 100 for _ in CARS]
    cars = zip(CARS, charges, ratings, strict=True)
    return " · ".join(f"{kind}#ev{n}<soc={soc}, rating={size}>" for n, soc, size in cars)


def _chargers(folder: Path, seed: int, kind: str) -> str:
    """The string of charging points as in the example's Charger.py."""
    np.random.seed(seed)
    names = _script(folder / "Charger.py", "Charger")
    voltages = names["calc_charging_voltage"](names["get_new_EV"](len(CARS))[-1])
    points = zip(CARS, voltages, strict=True)
    return " · ".join(f"{kind}#ev{number}<voltage={volts}>" for number, volts in points)


def _config(name: str, output: str, datum: str, source: str) -> Mapping[str, Any]:
    """The federate of the example, with the names of a world, and its own as aliases."""
    kind = output.partition("_")[2]
    return {
        WAITS: name == "Battery",
        "publications": [{"key": f"ev{car}.{kind}", "type": "double"} for car in CARS],
        "inputs": [
            {"key": f"ev{car}.{datum}", "type": "double", "targets": [source.format(car)]}
            for car in CARS
        ],
        "aliases": [[f"{name}/ev{car}.{kind}", output.format(car)] for car in CARS],
    }


def _endpoint(name: str, receives: str, sends: str, **more: str) -> Mapping[str, Any]:
    return {"key": name, "global": True, "tags": {"receives": receives, "sends": sends}, **more}


def _federate(role: str, folder: Path) -> tuple[World, Mapping[str, Any]]:
    """A world in place of a federate of an example, and its configuration."""
    current, voltage = "Battery/EV{}_current", "Charger/EV{}_voltage"
    if role == "Controller":
        world = World(
            "AController#controller", agents=[Controller], symbols=[CHARGE, COMMAND], name="control"
        )
        own = _endpoint("Controller/ep", "controller.eCharge", "controller.eCommand")
        theirs = folder / "ControllerConfig.json"
        config = json.loads(theirs.read_text(encoding="utf-8")) if theirs.exists() else {}
        # It answers before the next step of the others.
        filters = {"filters": config["filters"]} if "filters" in config else {}
        return world, {"endpoints": [own], "period": PERIOD / 2, **filters}
    if folder.name != "endpoints":
        if role == "Battery":
            text, agents, types = _batteries(folder, 628, "ABattery"), [Battery], [VOLTAGE]
            config = _config(role, current, "eVoltage.volts", voltage)
        else:
            text, agents, types = _chargers(folder, 1490, "ACharger"), [Charger], [CURRENT]
            config = _config(role, voltage, "eCurrent.amperes", current)
        return World(text, agents=agents, symbols=types, name=role), config
    if role == "Battery":
        text, agents, services = _batteries(folder, 2622, "ACell"), [Cell], []
        names, tags, offset = (current, voltage), ("eVolts", "eAmperes"), 10.0
    else:
        text, agents, services = _chargers(folder, 267, "APlug"), [Plug], [each(BEGIN)]
        names, tags, offset = (voltage, current), ("eAmperes", "eVolts"), 0.0
    world = World(text, agents=agents, symbols=[*TEXTS, BEGIN], services=services, name=role)
    endpoints = [
        _endpoint(
            names[0].format(car),
            *(f"ev{car}.{tag}" for tag in tags),
            destination=names[1].format(car),
        )
        for car in CARS
    ]
    return world, {"endpoints": endpoints, "offset": offset}


def _days(folder: Path) -> float:
    """The duration of an example, from its script, or from the options in its list."""
    found = re.search(r"hours = 24 ?\* ?(\d+)", (folder / "Charger.py").read_text(encoding="utf-8"))
    (runner, *_) = folder.glob("*runner*.json")
    found = found or re.search(r"--days=([\d.]+)", runner.read_text(encoding="utf-8"))
    return float(found[1]) if found else 1.0


def _take_part(role: str, folder: Path) -> None:
    from minerva_cosimulation.helics import WorldFederate

    world, config = _federate(role, folder)
    with TemporaryDirectory(prefix="minerva-acceptance-") as place:
        file = Path(place, f"{role}.json")
        common = {"name": role, "core_type": "zmq", "period": PERIOD}
        file.write_text(json.dumps({**common, **config}), encoding="utf-8")
        print(WorldFederate(world, file).run(until=DAY * _days(folder) + PERIOD))


def _run_script(path: Path, results: Path) -> None:
    import helics

    request: Any = helics.helicsFederateRequestTime

    def request_time(federate: Any, moment: float) -> float:
        # It has its results, and waits for the others to leave; HELICS may hang then.
        return moment if moment >= helics.HELICS_TIME_MAXTIME else request(federate, moment)

    if path.stem in ("Battery", "Charger"):
        helics.helicsFederateRequestTime = request_time
    os.chdir(path.parent)  # It reads its configuration there.
    names = _script(path, "__main__")
    series = next(names[name] for name in ("power", "soc_list", "soc") if name in names)
    rows = [*series.values()] if isinstance(series, dict) else [series]
    results.write_text(json.dumps(rows), encoding="utf-8")


def _broker(federates: str) -> None:
    import helics

    broker = helics.helicsCreateBroker("zmq", "", f"--federates {federates}")
    while helics.helicsBrokerIsConnected(broker):
        time.sleep(0.1)


def _federates(folder: Path) -> dict[str, list[str]]:
    """The scripts of an example by federate, each with its arguments."""
    # Of two ways to run an example, the last one works by the page of the example.
    runner = sorted(folder.glob("*runner*.json"))[-1]
    listed = json.loads(runner.read_text(encoding="utf-8"))["federates"]
    words = {federate["name"]: federate["exec"].split() for federate in listed}
    return {name: word[2:] for name, word in words.items() if word[0] == "python"}


def _federation(folder: Path, results: Path, world: str = "") -> dict[str, Any]:
    """The results of the scripts by federate, with a world in place of that of this name."""
    federates = _federates(folder)
    commands = [["broker", str(len(federates))]]
    for name, (script, *arguments) in federates.items():
        (results / name).unlink(missing_ok=True)
        own = ["script", str(folder / script), str(results / name), *arguments]
        commands.append(["world", name, str(folder)] if name == world else own)
    processes = [
        subprocess.Popen(
            [sys.executable, "-m", __name__, *command],
            cwd=Path(__file__).resolve().parents[2],
            stdout=subprocess.DEVNULL,
            stderr=subprocess.DEVNULL,
        )
        for command in commands
    ]
    end = time.monotonic() + SECONDS
    try:
        for process in processes:
            process.wait(max(0.0, end - time.monotonic()))
    except subprocess.TimeoutExpired:
        pass
    finally:
        for process in processes:
            process.kill()
            process.wait()
    written = [name for name in federates if (results / name).exists()]
    return {name: json.loads((results / name).read_text(encoding="utf-8")) for name in written}


def _problems(ours: Mapping[str, Any], theirs: Mapping[str, Any], world: str) -> Iterator[str]:
    """How the results with a world differ from those of the example."""
    for name in sorted(theirs.keys() - {world}):
        if name not in ours:
            yield f"{name} has no results"
        for place, (series, wanted) in enumerate(
            zip(ours.get(name, []), theirs[name], strict=False)
        ):
            pairs = enumerate(zip(series, wanted, strict=False))
            step = next((n for n, (own, other) in pairs if own != other), len(series))
            if series != wanted:
                yield f"{name}, series {place}: another value in step {step}"


def _example(folder: Path, place: Path) -> Path:
    """A copy of an example whose federates get their first time."""
    copy = Path(shutil.copytree(folder, place / folder.name))
    for path in copy.glob("*Config.json"):
        config = json.loads(path.read_text(encoding="utf-8"))
        if config.get("offset"):
            config.pop(WAITS, None)
        path.write_text(json.dumps(config), encoding="utf-8")
    return copy


def _results(folder: Path) -> Iterator[Result]:
    if not find_spec("helics"):
        raise MissingSuiteError("it needs HELICS: pip install 'minerva-bus[helics]'")
    for script in sorted(folder.rglob("Charger.py")):
        with TemporaryDirectory(prefix="minerva-acceptance-") as place:
            example, results = _example(script.parent, Path(place)), Path(place)
            theirs, names = _federation(example, results), _federates(example)
            roles = ["Controller"] if "Controller" in names else sorted(names)
            missing = [f"{name} has no results" for name in names if name not in theirs]
            for role in roles:
                case = f"{example.name}, {role} as a world"
                if missing:
                    yield judged(case, missing, STUCK if "filter" in example.name else "")
                else:
                    yield judged(case, _problems(_federation(example, results, role), theirs, role))


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
        case ["script", path, results, *arguments]:
            sys.argv = [path, *arguments]
            _run_script(Path(path), Path(results))
        case _:
            _broker(sys.argv[-1])


if __name__ == "__main__":
    main()
