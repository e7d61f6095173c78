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
from types import ModuleType
from typing import Any, Final

from minerva_bus.errors import MisuseError
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


@cache
def load_kernel(text: str, purpose: str) -> Kernel:
    """The function `run` of a generated module. Raises MisuseError without numba.

    Args:
        text: of the module.
        purpose: what needs numba, such as "compiled methods".

    """
    return _generated(text, _versions(purpose)).run


def has_numba() -> bool:
    """Whether numba is installed, which is not imported."""
    return importlib.util.find_spec("numba") is not None


def _generated(text: str, versions: str) -> ModuleType:
    """A module with this text, imported."""
    name = "minerva_" + blake2b(f"{versions}\n{text}".encode(), digest_size=16).hexdigest()
    path = _written(cache_folder() / f"{name}.py", text)
    spec = importlib.util.spec_from_file_location(name, path)
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    # The kept machine code refers to its module by name.
    sys.modules[name] = module
    spec.loader.exec_module(module)
    return module


def _versions(purpose: str) -> str:
    """The versions that machine code depends on. Raises MisuseError without numba."""
    # SVML has other last bits than the C library. numba reads the variable when it is imported.
    os.environ.setdefault("NUMBA_DISABLE_INTEL_SVML", "1")
    try:
        import numba  # pyright: ignore[reportMissingTypeStubs]
    except ImportError:
        raise MisuseError(f"{purpose} need numba: {install('fast')}") from None
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
