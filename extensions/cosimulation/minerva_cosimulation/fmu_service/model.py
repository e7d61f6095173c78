"""An FMU for co-simulation that FMPy steps: https://fmi-standard.org."""

from __future__ import annotations

import shutil
import sys
import tempfile
from collections.abc import Callable, Mapping
from math import prod
from pathlib import Path
from struct import error as struct_error
from struct import pack, unpack
from typing import Any, Final, NoReturn
from zipfile import ZipFile

import fmpy  # pyright: ignore[reportMissingTypeStubs]
from fmpy.fmi1 import FMICallException  # pyright: ignore[reportMissingTypeStubs]
from fmpy.fmi2 import FMU2Slave  # pyright: ignore[reportMissingTypeStubs]
from fmpy.fmi3 import FMU3Slave  # pyright: ignore[reportMissingTypeStubs]

from minerva_bus.errors import MisuseError, nearest
from minerva_bus.files import is_stream

_INTEGERS: Final = {
    **{f"Int{bits}": (-(1 << bits - 1), 1 << bits - 1) for bits in (8, 16, 32, 64)},
    **{f"UInt{bits}": (0, 1 << bits) for bits in (8, 16, 32, 64)},
    "Integer": (-(1 << 31), 1 << 31),
}
"""Their least value and the end of their values; FMPy would drop the higher bits of others."""


def _whole(value: Any) -> int:
    if int(value) != value:
        raise ValueError
    return int(value)


def _single(value: Any) -> float:
    return unpack("<f", pack("<f", value))[0]


_TYPES: Final[Mapping[str, Callable[[Any], Any]]] = {
    **dict.fromkeys(("Float64", "Real"), float),
    "Float32": _single,
    **dict.fromkeys(_INTEGERS, _whole),
    "Boolean": bool,
    "String": str,
    "Binary": bytes.fromhex,
}
"""Types of FMI 2 and 3 with values in a string; bytes are a text of hexadecimal digits there."""
_VERSIONS: Final[Mapping[str, Any]] = {"2.0": FMU2Slave, "3.0": FMU3Slave}
_MAX_PROBLEM: Final = 300
"""Characters of an error that FMPy explains in a line for each mistake in the model description."""
MAX_EXTRACTED: Final = 1 << 30
"""Bytes of the files in an FMU: a few kilobytes can unpack to more than a disk holds."""
_DISCARD: Final = 2
_ERROR: Final = 3
_FATAL: Final = 4
"""Statuses of calls, as in the standard."""
_TERMINATED: Final = 3
"""The kind of status of FMI 2 that says whether the FMU wants to end."""


class FmuModel:
    """An instance of an FMU.

    Args:
        path: the file.
        starts: values of parameters and inputs before the first step, by name.

    Raises MisuseError if the file is no FMU for co-simulation of FMI 2 or 3 that runs on this
    machine, and if HELICS is loaded in this process.

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
        self._end: float | None = None
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
        kind = self._type(name)
        if kind not in _TYPES:
            raise MisuseError(f"fmu: {name} is {kind}, which has no values in a string")

    def set(self, name: str, value: Any) -> None:
        """Set a variable, an array to its values in a list. Raises MisuseError."""
        kind, size = self._type(name), self._size(name)
        values: list[Any] = [value] if size is None else list(value) if _is_list(value) else []
        if len(values) != (1 if size is None else size):
            raise MisuseError(f"fmu: {name} is an array of {size} {kind}, not {value!r:.60}")
        try:
            converted: list[Any] = [_TYPES[kind](each) for each in values]
        except (TypeError, ValueError, OverflowError, struct_error):
            raise MisuseError(f"fmu: {name} is {kind}, not {value!r:.60}") from None
        least, end = _INTEGERS.get(kind, (0, 0))
        for each in converted if kind in _INTEGERS else ():
            if not least <= each < end:
                raise MisuseError(f"fmu: {name} is {kind}, which cannot be {each}")
        self._call(f"set{kind}", [self._variables[name].valueReference], converted)

    def get(self, name: str) -> Any:
        """The value of a variable, of an array a list. Raises MisuseError if the FMU fails."""
        size = self._size(name)
        further = () if size is None else (size,)
        reference = self._variables[name].valueReference
        values = self._call(f"get{self._type(name)}", [reference], *further)
        values = [_plain(value, self._type(name)) for value in values]
        return values[0] if size is None else values

    def step(self, time: float, duration: float) -> None:
        """Step from a time for a duration in seconds. Raises MisuseError if the FMU fails.

        An FMU may end the simulation in a step, which it then has made; the next is an error.
        """
        if self._end is not None:
            raise MisuseError(
                f"fmu: {self._path} ended the simulation in its step to {self._end:g} s;"
                " run only the frames before"
            )
        if self._steps(time, duration):
            self._end = time + duration

    def _steps(self, time: float, duration: float) -> bool:
        """Whether the FMU ended the simulation in the step that it made."""
        if isinstance(self._slave, FMU3Slave):
            return self._call("doStep", time, duration)[1]
        try:
            self._slave.doStep(time, duration)
        except FMICallException as error:
            if error.status == _DISCARD and self._call("getBooleanStatus", _TERMINATED):
                return True
            self._raise(error)
        return False

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
        if described.fmiVersion not in _VERSIONS or described.coSimulation is None:
            raise MisuseError(
                f"fmu: {self._path} is of FMI {described.fmiVersion}; expected an FMU for"
                f" co-simulation of FMI {' or '.join(_VERSIONS)}"
            )
        self._enumeration = "Int64" if described.fmiVersion == "3.0" else "Integer"
        self._variables = {variable.name: variable for variable in described.modelVariables}
        slave: Any = _VERSIONS[described.fmiVersion](
            guid=described.guid,
            unzipDirectory=fmpy.extract(str(self._path), unzipdir=self._folder),
            modelIdentifier=described.coSimulation.modelIdentifier,
            instanceName=self._path.stem,
        )
        slave.instantiate()
        self._slave = slave
        for name in starts:
            self.check(name)
        sizes = [n for n in starts if self._variables[n].causality == "structuralParameter"]
        if sizes:
            slave.enterConfigurationMode()
            for name in sizes:
                self.set(name, starts[name])
            slave.exitConfigurationMode()
        for name in starts:
            if name not in sizes:
                self.set(name, starts[name])
        if described.fmiVersion == "2.0":
            slave.setupExperiment()
        slave.enterInitializationMode()
        slave.exitInitializationMode()

    def _type(self, name: str) -> str:
        """The type of a variable, of an enumeration that of its numbers."""
        kind: str = self._variables[name].type
        return self._enumeration if kind == "Enumeration" else kind

    def _size(self, name: str) -> int | None:
        """The number of values of an array; None for other variables."""
        dimensions = self._variables[name].dimensions
        if not dimensions:
            return None
        return prod(
            int(each.start) if each.variable is None else self.get(each.variable.name)
            for each in dimensions
        )

    def _call(self, function: str, *arguments: Any) -> Any:
        try:
            return getattr(self._slave, function)(*arguments)
        except FMICallException as error:
            self._raise(error)

    def _raise(self, error: FMICallException) -> NoReturn:
        self._status = max(self._status, int(error.status))
        raise MisuseError(
            f"fmu: {self._path}: {error}; the FMU's own message, if any, is above"
        ) from None


def _is_list(value: Any) -> bool:
    return isinstance(value, list | tuple)


def _plain(value: Any, kind: str) -> Any:
    """A value of FMPy as that of a string."""
    if kind == "Boolean":  # A number in FMI 2.
        return bool(value)
    if kind == "Binary":
        return (value or b"").hex()
    return value.decode() if isinstance(value, bytes) else value
