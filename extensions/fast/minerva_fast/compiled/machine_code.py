"""Generated modules as files, imported and compiled by numba, whose machine code is kept there.

A generated module is written to a file named by the hash of its text and of all versions, and
imported like any other module: the project evaluates no text. The folder must belong to this user
and be writable by nobody else, because the modules run, and numba unpickles its machine code from
files beside them.
"""

from __future__ import annotations

import importlib.util
import os
import sys
from collections.abc import Callable, Mapping
from functools import cache
from hashlib import blake2b
from pathlib import Path
from tempfile import TemporaryDirectory
from types import FunctionType, ModuleType
from typing import Any, Final, TypeGuard

from minerva_bus import portable
from minerva_bus.errors import MisuseError
from minerva_bus.portable import trigonometry
from minerva_bus.wording import install

Kernel = Callable[..., int]

NUMBA_OPTIONS: Final[Mapping[str, Any]] = {
    "error_model": "python", "fastmath": False, "_nrt": False,
}  # fmt: skip
"""Python's errors, such as ZeroDivisionError, and sums in the order of the source, so that machine
code has the bits of Python.

Without numba's runtime (NRT), code cannot create arrays and does not count references to them. Each
inlined function counted those to all of its arrays, which took up to six times as long as its
work."""

ALLOCATING: Final[Mapping[str, Any]] = {**NUMBA_OPTIONS, "_nrt": True}
"""For functions that create arrays, which the runtime has to release."""


@cache
def load_kernel(text: str) -> Kernel:
    """The kernel of a generated module. Raises MisuseError without numba."""
    return generated(text, versions("compiled methods")).run


def generated(text: str, *parts: str) -> ModuleType:
    """A module with this text, imported in each call.

    `parts` are what its machine code depends on besides the text. The name of its file is a hash of
    all.
    """
    key = "\n".join([*parts, text])
    name = "minerva_" + blake2b(key.encode(), digest_size=16).hexdigest()
    path = _written(cache_folder() / f"{name}.py", text)
    spec = importlib.util.spec_from_file_location(name, path)
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    # The kept machine code refers to its module by name.
    sys.modules[name] = module
    spec.loader.exec_module(module)
    return module


def numba_library(purpose: str) -> Any:
    """The library numba, for a purpose such as "compiled methods". Raises MisuseError."""
    # SVML has other last bits than the C library. numba reads the variable when it is imported.
    os.environ.setdefault("NUMBA_DISABLE_INTEL_SVML", "1")
    try:
        import numba  # pyright: ignore[reportMissingTypeStubs]
    except ImportError:
        raise MisuseError(f"{purpose} need numba: {install('fast')}") from None
    return numba


def versions(purpose: str) -> str:
    """The versions that machine code depends on. Raises MisuseError without numba.

    Args:
        purpose: what needs numba, for the message.

    """
    numba = numba_library(purpose)
    import numpy as np

    import minerva_bus

    made = (sys.version, numba.__version__, np.__version__, minerva_bus.__version__)
    return "\n".join([*made, _sources()])


@cache
def _sources() -> str:
    """A hash of the functions that generated modules use, which change between two versions."""
    from minerva_bus import portable

    digest = blake2b(digest_size=16)
    for folder in (Path(__file__).parent, Path(portable.__file__).parent):
        for path in sorted(folder.glob("*.py")):
            digest.update(path.read_bytes())
    return digest.hexdigest()


def _written(path: Path, text: str) -> Path:
    """The file with this text; replaced at once, because several processes may write it."""
    if not path.exists() or path.read_text(encoding="utf-8") != text:
        temporary = path.with_suffix(f".{os.getpid()}.tmp")
        temporary.write_text(text, encoding="utf-8")
        temporary.replace(path)
    return path


@cache
def cache_folder() -> Path:
    """The user's folder of generated modules; a temporary one if it cannot be used or trusted."""
    named = os.environ.get("XDG_CACHE_HOME")
    try:
        base = Path(named) if named else Path.home() / ".cache"
        folder = base / "minerva-bus" / "compiled"
        folder.mkdir(mode=0o700, parents=True, exist_ok=True)
        status = folder.lstat()
        own = status.st_uid == os.getuid() and not status.st_mode & 0o022
        if own and not folder.is_symlink() and os.access(folder, os.W_OK | os.X_OK):
            return folder
    except (OSError, RuntimeError):  # RuntimeError: this user has no home
        pass
    _temporary.append(TemporaryDirectory(prefix="minerva-compiled-"))
    return Path(_temporary[-1].name)


_temporary: list[TemporaryDirectory[str]] = []
"""Kept, because such a folder is removed with its object."""


class PortableForms:
    """Compiled forms for one number of functions of `portable`, each made once."""

    def __init__(self, compiled: Callable[..., Any], far: Callable[..., Any]) -> None:
        """Create the forms.

        Args:
            compiled: numba's decorator with its options.
            far: in place of the reduction of huge angles, which needs ints of any length.

        """
        self._compiled = compiled
        self._made: dict[FunctionType, Any] = {trigonometry.far: compiled(far)}

    def of(self, function: Any) -> Any:
        """A function of `portable` and the functions of `portable` that it calls, compiled."""
        form: FunctionType = getattr(function, "one", function)
        if form not in self._made:
            scope = dict(form.__globals__)
            for name in form.__code__.co_names:
                if is_portable(scope.get(name)):
                    scope[name] = self.of(scope[name])
            self._made[form] = self._compiled(FunctionType(form.__code__, scope, form.__name__))
        return self._made[form]


def is_portable(value: Any) -> TypeGuard[FunctionType]:
    """Whether an object is a function of `portable`."""
    return isinstance(value, FunctionType) and value.__module__.startswith(portable.__name__)
