"""Generated functions around kernels: modules in the user's cache folder, compiled by numba.

numba keeps machine code beside the file of a function (`minerva_fast.compiled.machine_code`). The
name of the file is a digest of everything that the machine code consists of. Several threads share
the rows of an independent rule.
"""

from __future__ import annotations

import os
import threading
from collections.abc import Callable, Iterator, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor, wait
from dataclasses import dataclass, field
from functools import cache
from hashlib import blake2b
from pathlib import Path
from types import ModuleType
from typing import Any, Final, Protocol, cast

import numpy as np
from numpy.typing import NDArray

from minerva_bus.world.class_declaration import NotCompilable
from minerva_fast.compiled.machine_code import generated, versions
from minerva_fast.space.checking import uncompilable
from minerva_fast.space.kernels import (
    ALLOCATING_OPTIONS,
    OPTIONS,
    PURPOSE,
    Guard,
    Kernel,
    interpreting,
    key,
    numba,
)

Function = Callable[..., Any]
_HEADS: Final = (
    "Failed in", "During:", "File ", "No implementation of", ">>>", "There are", "- Of which",
    "Overload", "With argument", "No match", "Rejected", "raised from",
)  # fmt: skip
"""Beginnings of lines in a message of numba that give no reason."""
_REASON: Final = "TypingError: "
"""Before a reason that a type of this project gives."""

_TYPES: Final = "an operation on values of these types"


@dataclass(slots=True)
class RuleLoop:
    """The function `drive` of a source, whose kernels and tuples are in `scope`.

    Attributes:
        name: for messages.
        source: the text of the module.
        scope: kernels and named tuples by the names that the source uses.
        signature: argument and result types in numba's notation.
        check: raises NotCompilable if a kernel that is defined below the rule cannot be compiled.

    """

    name: str
    source: str
    scope: Mapping[str, Any]
    signature: str
    check: Callable[[], None] | None = None
    _compiled: Function | None = field(default=None, repr=False)
    _compiled_keys: tuple[str, ...] = ()
    _interpreted: Function | None = field(default=None, repr=False)

    def __call__(self, *arguments: Any) -> Any:
        """Run it, compiled or, within `interpreted`, as Python. Raises MisuseError."""
        if interpreting():
            if self._interpreted is None:
                self._check()
                self._interpreted = _with_globals(generated(self.source), self.scope)
            return self._interpreted(*arguments)
        compiled = self._compiled  # A frame calls several, so without a call of ours.
        return (self._machine_code() if compiled is None else compiled)(*arguments)

    def prepare(self) -> None:
        """Compile it now, unless it is to run as Python. Raises MisuseError."""
        if not interpreting():
            keys = tuple(self._keys())
            if keys != self._compiled_keys:  # such as a constant of a notebook that was changed
                self._compiled = None
                for value in self.scope.values():
                    if isinstance(value, Kernel):
                        value.forget()
            self._machine_code()

    def _machine_code(self) -> Function:
        if self._compiled is None:
            self._compiled_keys = tuple(self._keys())
            self._compiled = self._compile()
        return self._compiled

    def _check(self) -> None:
        if self.check is not None:
            self.check()

    def _compile(self) -> Function:
        self._check()
        library = numba()
        scope = {
            name: value.compiled if isinstance(value, Kernel | Guard) else value
            for name, value in self.scope.items()
        }
        options = repr(sorted(OPTIONS.items()))
        parts = versions(PURPOSE), options, _sources(), self.signature, *self._keys()
        function = _with_globals(generated(self.source, *parts), scope)
        try:
            return library.njit(self.signature, cache=True, pipeline_class=compiler(), **OPTIONS)(
                function
            )
        except library.core.errors.NumbaError:
            # The rule may create arrays; if that is not the reason, the error is the same again.
            return self._compile_allocating(function)

    def _compile_allocating(self, function: Function) -> Function:
        library = numba()
        try:
            return library.njit(
                self.signature, cache=True, pipeline_class=compiler(), **ALLOCATING_OPTIONS
            )(function)
        except library.core.errors.NumbaError as error:
            raise self._problem(error) from None

    def _problem(self, error: Any) -> NotCompilable:
        """The error at the line for which numba has no types."""
        reasons = [line.strip() for line in str(error.msg).splitlines()]
        what = next((line for line in reasons if line and not line.startswith(_HEADS)), _TYPES)
        what = next((line for line in reasons if line.startswith(_REASON)), what)
        what = what.removeprefix(_REASON)
        if "tuple length" in what:
            what = "a tuple of another length; write lattice.width for the width of a lattice"
        if "UndefinedType" in what:
            what = "a name that is not defined"
        rule = self.scope.get("rule")
        if not isinstance(rule, Kernel) or error.loc is None:
            return NotCompilable(f"{self.name} cannot be compiled: {what}")
        return uncompilable(
            cast("Kernel[..., Any]", rule), error.loc.filename, error.loc.line, what
        )

    def _keys(self) -> Iterator[str]:
        """Digests of the objects in the scope, by name."""
        for name, value in sorted(self.scope.items()):
            yield name
            match value:
                case Kernel():
                    yield key(value.function)
                case Guard():
                    yield value.key
                case _:
                    yield str(value._fields)


@cache
def _sources() -> str:
    """A digest of this package, whose types and operators are part of the machine code."""
    digest = blake2b()
    for path in sorted(Path(__file__).parent.glob("*.py")):
        digest.update(path.read_bytes())
    return digest.hexdigest()


def compiler() -> Any:
    """The compiler of rules. Raises ImportError without numba."""
    # Here, because numba is optional.
    from minerva_fast.space.pipeline import RuleCompiler

    return RuleCompiler


def _with_globals(module: ModuleType, scope: Mapping[str, Any]) -> Function:
    """The function `drive` of a generated module, with these objects as its globals."""
    vars(module).update(scope)
    return module.drive


def around(kernel: Kernel[..., Any], types: Sequence[str], result: str = "void") -> RuleLoop:
    """A driver that passes its arguments to a kernel; the types are those of numba."""
    arguments = ", ".join([f"a{number}" for number in range(len(types))])
    source = f"def drive({arguments}):\n    return kernel({arguments})\n"
    return RuleLoop(kernel.__name__, source, {"kernel": kernel}, f"{result}({', '.join(types)})")


THREADS: Final = "MINERVA_THREADS"
"""The environment variable with the most threads of a rule; by default one for each core."""

PLACE, TURNS = 0, 1
"""Items of the `progress` of a rule: the place of the current row in the order of activation, and
the turns of this activation's `while` loops."""

_LOCK: Final = threading.Lock()
_ROWS: Final = 8192
"""Fewer rows take less time than a thread takes to start."""


def new_progress() -> NDArray[np.int64]:
    """The `progress` of a rule that has not begun, shape (2,)."""
    return np.zeros(2, np.int64)


class Part(Protocol):
    """Runs the rows from `begin` to `end`; `progress` has the current one."""

    def __call__(self, part: int, begin: int, end: int, progress: NDArray[np.int64]) -> None: ...


def parts_of(rows: int) -> int:
    """The number of threads for this many rows."""
    enough = rows // _ROWS
    return min(_most(), enough) if enough > 1 else 1


def run_parts(run: Part, rows: int, parts: int) -> tuple[int, Exception] | None:
    """Run all rows in parts, each in a thread; the first row that failed, and its error."""
    borders = [rows * part // parts for part in range(parts + 1)]

    def run_part(part: int) -> tuple[int, Exception] | None:
        progress = new_progress()
        try:
            run(part, borders[part], borders[part + 1], progress)
        except Exception as error:
            return int(progress[PLACE]), error
        return None

    # This thread takes the first part, so a rule in two threads wakes one.
    with _LOCK:
        others = [_threads().submit(run_part, part) for part in range(1, parts)]
    try:
        first = run_part(0)
    finally:  # also if a person interrupts it: the others write to the same arrays
        wait(others)
    failures = [first, *[other.result() for other in others]]
    return next((failed for failed in failures if failed is not None), None)


@cache
def _threads() -> ThreadPoolExecutor:
    """The threads of this process, kept since each start of a pool takes 0.2 ms of CPU time."""
    return ThreadPoolExecutor(max(1, _most() - 1), "minerva-rule")


def _end_threads() -> None:
    """End the threads: a process that is forked from this one would not have them."""
    with _LOCK:
        if _threads.cache_info().currsize:
            _threads().shutdown()
            _threads.cache_clear()


if hasattr(os, "register_at_fork"):
    os.register_at_fork(before=_end_threads)


def _most() -> int:
    limit = os.environ.get(THREADS, "")
    if limit.isdecimal() and int(limit):
        return int(limit)
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1
