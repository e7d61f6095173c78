"""Generated functions around kernels: compiled by numba, and kept on disk.

numba keeps the compiled form of a function beside its file. So each source becomes a file with the
digest of everything that it consists of as its name, in the user's cache folder.
"""

from __future__ import annotations

import os
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from hashlib import blake2b
from pathlib import Path
from typing import Any, Final

import numpy as np

from minerva_bus import __version__
from minerva_bus.errors import MisuseError
from minerva_bus.space.kernels import OPTIONS, Kernel, interpreting, key, numba

Function = Callable[..., Any]
_SHOWN: Final = 6
"""Lines of a message of numba that an error repeats."""


@dataclass(slots=True)
class RuleLoop:
    """The function `drive` of a source, whose kernels and tuples are in `scope`.

    Attributes:
        name: for messages.
        source: the text of the module.
        scope: kernels and named tuples by the names that the source uses.
        signature: argument and result types in numba's notation.

    """

    name: str
    source: str
    scope: Mapping[str, Any]
    signature: str
    _compiled: Function | None = field(default=None, repr=False)

    def __call__(self, *arguments: Any) -> Any:
        """Run it, compiled or, within `interpreted`, as Python. Raises MisuseError."""
        if interpreting():
            # Products of words exceed 64 bits on purpose.
            with np.errstate(over="ignore"):
                return _drive(self.source, "<rule>", dict(self.scope))(*arguments)
        if self._compiled is None:
            self._compiled = self._compile()
        return self._compiled(*arguments)

    def _compile(self) -> Function:
        library = numba()
        file = _written(self._key(), self.source)
        scope = {
            name: value.compiled if isinstance(value, Kernel) else value
            for name, value in self.scope.items()
        }
        function = _drive(self.source, str(file or "<rule>"), scope)
        try:
            return library.njit(self.signature, cache=file is not None, **OPTIONS)(function)
        except library.core.errors.NumbaError as error:
            lines = [line for line in str(error).splitlines() if line.strip()]
            raise MisuseError(
                "\n  ".join([f"{self.name} cannot be compiled:", *lines[:_SHOWN]])
            ) from None

    def _key(self) -> str:
        parts = [__version__, self.source, self.signature]
        for name, value in sorted(self.scope.items()):
            parts += [
                name,
                key(value.function) if isinstance(value, Kernel) else str(value._fields),
            ]
        return blake2b("\n".join(parts).encode(), digest_size=12).hexdigest()


def around(kernel: Kernel[..., Any], types: Sequence[str]) -> RuleLoop:
    """A driver that passes its arguments to a kernel; `types` are those of numba."""
    arguments = ", ".join([f"a{number}" for number in range(len(types))])
    source = f"def drive({arguments}):\n    kernel({arguments})\n"
    return RuleLoop(kernel.__name__, source, {"kernel": kernel}, f"void({', '.join(types)})")


def _drive(source: str, file: str, scope: dict[str, Any]) -> Function:
    # A compiled function that is read from disk looks for a module of this name.
    scope |= {"__name__": __name__}
    exec(compile(source, file, "exec"), scope)  # noqa: S102 - the source is generated here
    return scope["drive"]


def _written(name: str, source: str) -> Path | None:
    """A file with this source; None if there is no folder for it."""
    home = os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache"
    file = Path(home) / "minerva-bus" / "kernels" / f"rule_{name}.py"
    try:
        if not file.exists():
            file.parent.mkdir(parents=True, exist_ok=True, mode=0o700)
            # Complete or absent: other processes may compile the same rule.
            part = file.with_suffix(f".{os.getpid()}")
            part.write_text(source, encoding="utf-8")
            part.replace(file)
    except OSError:
        return None
    return file
