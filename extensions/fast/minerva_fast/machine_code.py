"""Generated modules and their machine code, as files of the user.

A generated module is written to a file named by the hash of its text and of all versions, and
imported like any other module, which compiles it: the project evaluates no text. Its machine code
is kept beside it. The folder must belong to this user and be writable by nobody else, because both
run.
"""

from __future__ import annotations

import importlib.util
import os
import sys
from collections.abc import Callable
from functools import cache
from hashlib import blake2b
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Final

from minerva_bus.errors import MisuseError
from minerva_bus.files import replacing
from minerva_bus.wording import install

Kernel = Callable[..., int]

_SIZE: Final = 32
"""Bytes of a digest, which a file of machine code begins with."""


@cache
def load_kernel(text: str, purpose: str) -> Kernel:
    """The function `run` of a generated module. Raises MisuseError without numba.

    It does not look at the types of its arguments, which takes longer than a small rule.

    Args:
        text: of the module.
        purpose: what needs numba, such as "compiled methods".

    """
    versions = _versions(purpose)
    name = "minerva_" + blake2b(f"{versions}\n{text}".encode(), digest_size=16).hexdigest()
    path = cache_folder() / f"{name}.code"
    code = _kept(path)
    if code is None:
        code = _compiled(name, text)
        with replacing(path) as file:
            file.write(blake2b(code, digest_size=_SIZE).digest() + code)
    from minerva_fast.pipeline import loaded

    return loaded(name, code)


def _kept(path: Path) -> bytes | None:
    """The machine code of a file; None if there is none, or it is damaged."""
    try:
        content = path.read_bytes()
    except OSError:
        return None
    digest, code = content[:_SIZE], content[_SIZE:]
    return code if blake2b(code, digest_size=_SIZE).digest() == digest else None


def has_numba() -> bool:
    """Whether numba is installed, which is not imported."""
    return importlib.util.find_spec("numba") is not None


def _compiled(name: str, text: str) -> bytes:
    """The machine code of a generated module, which is imported."""
    path = cache_folder() / f"{name}.py"
    with replacing(path) as file:
        file.write(text.encode())
    spec = importlib.util.spec_from_file_location(name, path)
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module.run


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
    from minerva_fast.pipeline import machine

    made = (sys.version, numba.__version__, np.__version__, minerva_bus.__version__)
    return "\n".join([*made, machine(), _sources()])


@cache
def _sources() -> str:
    """A hash of the functions that generated modules use, which change between two versions."""
    from minerva_bus import portable

    digest = blake2b(digest_size=16)
    for folder in (Path(__file__).parent, Path(portable.__file__).parent):
        for path in sorted(folder.glob("*.py")):
            digest.update(path.read_bytes())
    return digest.hexdigest()


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
