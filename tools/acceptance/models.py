"""FMI: reference models, built by the C compiler, in a world beside their reference results."""

from __future__ import annotations

import csv
import json
import subprocess
from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import redirect_stderr, suppress
from importlib.util import find_spec
from io import StringIO
from math import isclose
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any
from zipfile import ZipFile

from minerva_bus import Agent, EventType, MinervaError, Primitive, World, on, run, service, view
from minerva_bus.grammar.types import INT_END
from tools.acceptance.suite import MissingSuiteError, Outcome, Result, Suite, judged

RELATIVE = 1e-9
"""Largest relative difference; the models step by themselves, and the files have 17 digits."""

OTHER_FILE = "the file of results is that of another model; the results are those of FMPy"
SCHEDULED = "a model for scheduled execution only, which is no co-simulation: it is refused"
LARGE = "whole numbers of a string end at 2^63, and one of the inputs is larger: it is refused"

_KINDS: Mapping[str, Any] = {"F": float, "R": float, "I": int, "U": int, "E": int, "B": bool}
"""Types of data, by the first letter of a type of FMI; text for the rest."""


def _built(model: Path, version: str, folder: Path) -> Path:
    """The FMU of a model. Raises MissingSuiteError without a C compiler."""
    sources = model.parent / "src"
    library = folder / f"{model.name}.so"
    command = ["cc", "-shared", "-fPIC", f"-DFMI_VERSION={version}", "-DDISABLE_PREFIX"]
    command += [f"-I{model.parent / 'include'}", f"-I{model}", "-o", str(library)]
    command += [str(sources / f"fmi{version}Functions.c"), str(sources / "cosimulation.c")]
    try:
        subprocess.run([*command, str(model / "model.c"), "-lm"], check=True, capture_output=True)
    except (OSError, subprocess.CalledProcessError) as error:
        raise MissingSuiteError(f"the C compiler cannot build {model.name}: {error}") from None
    platform = {"2": "linux64", "3": "x86_64-linux"}[version]
    fmu = folder / f"{model.name}.fmu"
    with ZipFile(fmu, "w") as archive:
        archive.write(model / f"FMI{version}.xml", "modelDescription.xml")
        archive.write(library, f"binaries/{platform}/{library.name}")
        for resource in model.glob("*.txt"):
            archive.write(resource, f"resources/{resource.name}")
    return fmu


def _kind(variable: Any) -> Any:
    """The type of its values in a string."""
    kind = str if variable.type == "Binary" else _KINDS.get(variable.type[0], str)
    return tuple[kind, ...] if variable.dimensions else kind


def _stepped(fmu: Path, kinds: Mapping[str, Any], dt: float, frames: int, **inputs: Any) -> Any:
    """Rows of the outputs of these types, by name; row `n` follows `n` steps by the bridge."""
    from minerva_cosimulation.fmu_service import Fmu

    received: Any = EventType("eResult", **kinds)
    shown = EventType("eShown", visual=True)
    types: Any = {name: type(value) for name, value in inputs.items()}
    given: Any = Primitive("PGiven", **types)

    class Recorder(Agent, symbol="ARecorder"):
        row: str = "{}"

        @on("eResult")
        def record(self, result: Any, moment: Any) -> None:
            self.row = json.dumps({name: getattr(result, name) for name in kinds})

        @view("eShown")
        def draw(self, event: Any) -> Any:
            return given(**inputs)

    master = service(
        Fmu,
        path=str(fmu),
        event="eResult",
        outputs=", ".join(f"{name}={name}" for name in kinds),
        inputs=", ".join(f"{name}=PGiven.{name}" for name in inputs),
        draws="eShown" if inputs else "",
    )
    symbols: list[Any] = [received, shown, given]
    world = World(
        "ARecorder#r", agents=[Recorder], services=[master], symbols=symbols, name="fmi", dt=dt
    )
    with redirect_stderr(StringIO()):  # The log of a refused value.
        done = run(world, frames=frames, collect={"row": Recorder.row})
    return [json.loads(row) for row in done.table("ARecorder")["row"]]


def _value(text: str, kind: Any) -> Any:
    if kind is bool:
        return text == "true"
    if kind in (int, float, str):
        return kind(text)
    return [float(item) for item in text.split()]


def _is_near(value: Any, other: Any) -> bool:
    if isinstance(value, list):
        return len(value) == len(other) and all(map(_is_near, value, other))
    if isinstance(value, float):
        return isclose(value, other, rel_tol=RELATIVE, abs_tol=RELATIVE)
    return value == other


def _rows(path: Path) -> list[dict[str, str]]:
    if not path.exists():
        return []
    with path.open(encoding="utf-8", newline="") as file:
        return list(csv.DictReader(file))


def _variables(fmu: Path, names: Iterable[str]) -> dict[str, Any]:
    """The types of those of these variables that the model has."""
    import fmpy  # pyright: ignore[reportMissingTypeStubs]

    variables: list[Any] = fmpy.read_model_description(str(fmu)).modelVariables
    return {each.name: _kind(each) for each in variables if each.name in {*names} - {"time"}}


def _problems(fmu: Path, rows: Sequence[Mapping[str, str]]) -> Iterator[str]:
    """What differs in the outputs of a model from its reference results."""
    kinds = _variables(fmu, rows[0])
    if not kinds:
        yield f"the model has none of the variables {', '.join(rows[0])}"
        return
    dt = (float(rows[-1]["time"]) - float(rows[0]["time"])) / (len(rows) - 1)
    try:
        table = _stepped(fmu, kinds, dt, len(rows) - 1)
    except MinervaError as error:
        yield str(error)
        return
    for step, row in enumerate(rows[1:], 1):
        for name, kind in kinds.items():
            value = table[step][name]
            if not _is_near(_value(row[name], kind), value):
                yield f"{name} is {value} at {row['time']}; expected {row[name]}"


def _passed_through(fmu: Path, row: Mapping[str, str]) -> Iterator[str]:
    """What a model of which each output has an input's value makes of these inputs."""
    kinds = _variables(fmu, row)
    inputs = {name: _value(row[name].strip('"'), kind) for name, kind in kinds.items()}
    outputs = {name.replace("_input", "_output"): value for name, value in inputs.items()}
    try:
        table = _stepped(fmu, _variables(fmu, outputs), 0.1, 3, **inputs)
    except MinervaError as error:
        yield str(error)
        return
    for name, value in outputs.items():
        if table[3][name] != value:
            yield f"{name} is {table[3][name]}; expected {value}"


def _exported(folder: Path) -> Iterator[str]:
    """What FMPy's checks and a simulation by FMPy say of a world that is an FMU."""
    import fmpy  # pyright: ignore[reportMissingTypeStubs]
    from fmpy.validation import validate_fmu  # pyright: ignore[reportMissingTypeStubs]

    from minerva_cosimulation.fmi import export_fmu

    path = export_fmu(
        "flock", folder / "flock.fmu", inputs=["b0.eTurn.angle"], outputs=["b0.x"], birds=20
    )
    yield from validate_fmu(str(path))
    end = fmpy.simulate_fmu(str(path), stop_time=0.4)["time"][-1]
    if not _is_near(float(end), 0.4):
        yield f"the simulation ends at {end}"


def _simulated(fmu: Path) -> list[dict[str, str]]:
    """Results of FMPy, as rows of a file of results."""
    import fmpy  # pyright: ignore[reportMissingTypeStubs]

    table: Any = fmpy.simulate_fmu(str(fmu), start_time=0.0, stop_time=0.01, output_interval=0.001)
    return [dict(zip(table.dtype.names, map(str, row), strict=True)) for row in table]


def _model_results(model: Path, version: str, folder: Path) -> Iterator[Result]:
    from minerva_cosimulation.fmu_service.model import FmuModel

    fmu = _built(model, version, folder)
    case, reference = f"FMI {version} {model.name}", model / f"{model.name}_out.csv"
    if not reference.exists():
        with suppress(MinervaError):
            FmuModel(fmu, {}).close()
            yield judged(case, ["a model without co-simulation is not refused"])
            return
        yield Result(case, Outcome.EXPECTED, SCHEDULED)
    elif _variables(fmu, (rows := _rows(reference))[0]):
        yield judged(case, _problems(fmu, rows))
    else:
        problems = [*_problems(fmu, _simulated(fmu))]
        yield judged(case, problems) if problems else Result(case, Outcome.EXPECTED, OTHER_FILE)
    for number, row in enumerate(_rows(model / f"{model.name}_in.csv"), 1):
        large = any(_value(text, float) >= INT_END for text in row.values())
        problems = _passed_through(fmu, row)
        yield judged(f"{case}, inputs {number}", problems, LARGE if large else "")


def _results(repository: Path) -> Iterator[Result]:
    if not (find_spec("fmpy") and find_spec("pythonfmu3")):
        raise MissingSuiteError("it needs FMPy: pip install 'minerva-bus[fmi]'")
    with TemporaryDirectory(prefix="minerva-acceptance-") as folder:
        for version in "32":
            for description in sorted(repository.glob(f"*/FMI{version}.xml")):
                yield from _model_results(description.parent, version, Path(folder))
        yield judged("a world in FMPy", _exported(Path(folder)))


REFERENCE_FMUS = Suite(
    "fmi",
    "modelica/Reference-FMUs",
    ".",
    "the bridge `fmu` as master of models in FMI 3 and 2; a world that is an FMU, in FMPy",
    _results,
)
