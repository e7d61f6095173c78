"""Generated modules as files, imported and compiled by numba, whose machine code is kept there.

A generated module is written to a file named by the hash of its text and of all versions, and
imported as any other module: no text is executed that is not a file whose content was checked. The
folder belongs to this user, and nobody else can write to it, because numba reads its machine code
from there.
"""

from __future__ import annotations

import importlib.util
import os
import sys
from collections.abc import Callable
from functools import cache
from hashlib import blake2b
from pathlib import Path
from tempfile import mkdtemp

from minerva_bus.errors import MisuseError

Kernel = Callable[..., int]


def loaded(text: str, title: str) -> Kernel:
    """The kernel of a generated module. Raises MisuseError without numba."""
    return _loaded(text)


@cache
def _loaded(text: str) -> Kernel:
    versions = _versions()
    name = "minerva_" + blake2b(f"{versions}\n{text}".encode(), digest_size=16).hexdigest()
    path = _written(_folder() / f"{name}.py", text)
    spec = importlib.util.spec_from_file_location(name, path)
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    # The kept machine code refers to its module by name.
    sys.modules[name] = module
    spec.loader.exec_module(module)
    return module.run


def _versions() -> str:
    """Everything besides the module's text that the machine code depends on. Raises MisuseError."""
    # SVML has other last bits than the C library. numba reads the variable when it is imported.
    os.environ.setdefault("NUMBA_DISABLE_INTEL_SVML", "1")
    try:
        import numba  # pyright: ignore[reportMissingTypeStubs]
    except ImportError:
        raise MisuseError(
            "compiled methods need numba, which is not installed; install minerva-bus[fast], or"
            " leave out compiled=True"
        ) from None
    import numpy as np

    return f"{sys.version} numba {numba.__version__} numpy {np.__version__} {_sources()}"


def _sources() -> str:
    """A hash of the functions that generated modules use."""
    from minerva_bus import portable

    folders = (Path(__file__).parent, Path(portable.__file__).parent)
    digest = blake2b(digest_size=16)
    for folder in folders:
        for path in sorted(folder.glob("*.py")):
            digest.update(path.read_bytes())
    return digest.hexdigest()


def _written(path: Path, text: str) -> Path:
    """The file with this text; written at once, so that processes may do so at the same time."""
    if not path.exists() or path.read_text(encoding="utf-8") != text:
        temporary = path.with_suffix(f".{os.getpid()}.tmp")
        temporary.write_text(text, encoding="utf-8")
        temporary.replace(path)
    return path


@cache
def _folder() -> Path:
    """The folder of generated modules of this user; a temporary one if that is not usable."""
    base = os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache"
    folder = Path(base) / "minerva-bus" / "compiled"
    try:
        folder.mkdir(mode=0o700, parents=True, exist_ok=True)
        state = folder.lstat()
        if state.st_uid == os.getuid() and not state.st_mode & 0o022 and not folder.is_symlink():
            return folder
    except OSError:
        pass
    return Path(mkdtemp(prefix="minerva-compiled-"))
