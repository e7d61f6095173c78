"""An FMU for co-simulation that FMPy steps: https://fmi-standard.org."""

from __future__ import annotations

import shutil
import sys
import tempfile
from collections.abc import Mapping
from pathlib import Path
from typing import Any, Final
from zipfile import ZipFile

import fmpy  # pyright: ignore[reportMissingTypeStubs]
from fmpy.fmi1 import FMICallException  # pyright: ignore[reportMissingTypeStubs]
from fmpy.fmi3 import FMU3Slave  # pyright: ignore[reportMissingTypeStubs]

from minerva_bus.errors import MisuseError, nearest
from minerva_bus.files import is_stream

_TYPES: Final = {"Float64": float, "Int64": int, "Int32": int, "Boolean": bool, "String": str}
"""Types of variables that have a value in a string."""
_BITS: Final = {"Int64": 64, "Int32": 32}
_MAX_PROBLEM: Final = 300
"""Characters of an error that FMPy explains in a line for each mistake in the model description."""
MAX_EXTRACTED: Final = 1 << 30
"""Bytes of the files in an FMU: a few kilobytes can unpack to more than a disk holds."""
_ERROR: Final = 3
_FATAL: Final = 4
"""Statuses of calls, as in the standard."""


class FmuModel:
    """An instance of an FMU.

    Args:
        path: the file.
        starts: values of parameters and inputs before the first step, by name.

    Raises MisuseError if the file is no FMU for co-simulation of FMI 3 that runs on this machine,
    and if HELICS is loaded in this process.

    """

    def __init__(self, path: Path, starts: Mapping[str, float]) -> None:
        if "helics" in sys.modules:
            # It exports the symbols of a C++ standard library of its own, which crashes FMUs.
            raise MisuseError(
                f"fmu: {path}: HELICS is loaded in this process, and FMUs crash with its library;"
                " let this service run in a process of its own, as `minerva run` does"
            )
        self._path = path
        self._folder = tempfile.mkdtemp(prefix="minerva-fmu-")
        self._slave: Any = None
        self._status = 0
        try:
            self._open(starts)
        except MisuseError:
            self.close()
            raise
        except Exception as error:  # FMPy raises Exception itself
            self.close()
            problem = " ".join(str(error).split())[:_MAX_PROBLEM] or type(error).__name__
            raise MisuseError(f"fmu: {path}: {problem}") from None

    def check(self, name: str) -> None:
        """Raise MisuseError if the FMU has no such variable, or one of an unknown type."""
        if name not in self._variables:
            raise MisuseError(
                f"fmu: {self._path} has no variable {name!r}{nearest(name, list(self._variables))}"
            )
        kind = self._variables[name].type
        if kind not in _TYPES:
            raise MisuseError(f"fmu: {name} is {kind}; expected {', '.join(_TYPES)}")

    def set(self, name: str, value: Any) -> None:
        """Set a variable. Raises MisuseError if the FMU rejects it."""
        variable = self._variables[name]
        try:
            converted = _TYPES[variable.type](value)
        except (TypeError, ValueError):
            raise MisuseError(f"fmu: {name} is {variable.type}, not {value!r:.60}") from None
        bits = _BITS.get(variable.type)
        # FMPy would drop the higher bits.
        if bits is not None and not -(1 << bits - 1) <= converted < 1 << bits - 1:
            raise MisuseError(f"fmu: {name} is {variable.type}, which cannot be {converted}")
        self._call(f"set{variable.type}", [variable.valueReference], [converted])

    def get(self, name: str) -> Any:
        """The value of a variable. Raises MisuseError if the FMU fails."""
        variable = self._variables[name]
        (value,) = self._call(f"get{variable.type}", [variable.valueReference])
        return value

    def step(self, time: float, duration: float) -> None:
        """Step from a time for a duration in seconds. Raises MisuseError if the FMU fails."""
        self._call("doStep", time, duration)

    def close(self) -> None:
        """End the FMU, and remove its extracted files."""
        slave, self._slave = self._slave, None
        # After an error only the instance may be freed. After a fatal one nothing may be called: an
        # FMU that has freed its memory by itself would corrupt that of this process.
        if slave is not None and self._status < _FATAL:
            if self._status < _ERROR:
                slave.terminate()
            slave.freeInstance()
        shutil.rmtree(self._folder, ignore_errors=True)

    def _open(self, starts: Mapping[str, float]) -> None:
        if is_stream(self._path):
            raise MisuseError(f"fmu: {self._path} is a pipe or device; expected a file")
        with ZipFile(self._path) as archive:
            size = sum(entry.file_size for entry in archive.infolist())
        if size > MAX_EXTRACTED:
            raise MisuseError(
                f"fmu: {self._path} unpacks to {size:,} bytes; expected at most {MAX_EXTRACTED:,}"
            )
        described: Any = fmpy.read_model_description(str(self._path))
        if described.fmiVersion != "3.0" or described.coSimulation is None:
            raise MisuseError(
                f"fmu: {self._path} is of FMI {described.fmiVersion}; expected an FMU for"
                " co-simulation of FMI 3.0"
            )
        self._variables = {variable.name: variable for variable in described.modelVariables}
        slave: Any = FMU3Slave(
            guid=described.guid,
            unzipDirectory=fmpy.extract(str(self._path), unzipdir=self._folder),
            modelIdentifier=described.coSimulation.modelIdentifier,
            instanceName=self._path.stem,
        )
        slave.instantiate()
        self._slave = slave
        for name, value in starts.items():
            self.check(name)
            self.set(name, value)
        slave.enterInitializationMode()
        slave.exitInitializationMode()

    def _call(self, function: str, *arguments: Any) -> Any:
        try:
            return getattr(self._slave, function)(*arguments)
        except FMICallException as error:
            self._status = max(self._status, int(error.status))
            raise MisuseError(
                f"fmu: {self._path}: {error}; the FMU's own message, if any, is above"
            ) from None
