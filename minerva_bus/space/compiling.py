"""Generated functions around kernels: modules in the user's cache folder, compiled by numba.

numba keeps machine code beside the file of a function (`minerva_bus.compiled.loading`). The name of
the file is a digest of everything that the machine code consists of.
"""

from __future__ import annotations

import sys
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, Final

import numpy as np

from minerva_bus import __version__
from minerva_bus.compiled.loading import generated
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
                return self._function(self.scope)(*arguments)
        if self._compiled is None:
            self._compiled = self._compile()
        return self._compiled(*arguments)

    def _compile(self) -> Function:
        library = numba()
        scope = {
            name: value.compiled if isinstance(value, Kernel) else value
            for name, value in self.scope.items()
        }
        function = self._function(scope)
        try:
            return library.njit(self.signature, cache=True, **OPTIONS)(function)
        except library.core.errors.NumbaError as error:
            lines = [line for line in str(error).splitlines() if line.strip()]
            raise MisuseError(
                "\n  ".join([f"{self.name} cannot be compiled:", *lines[:_SHOWN]])
            ) from None

    def _function(self, scope: Mapping[str, Any]) -> Function:
        """The function of the generated module, with these objects as its globals."""
        parts = [__version__, numba().__version__, np.__version__, sys.version, self.signature]
        for name, value in sorted(self.scope.items()):
            parts += [
                name,
                key(value.function) if isinstance(value, Kernel) else str(value._fields),
            ]
        module = generated("\n".join([*parts, self.source]), self.source)
        vars(module).update(scope)
        return module.drive


def around(kernel: Kernel[..., Any], types: Sequence[str]) -> RuleLoop:
    """A driver that passes its arguments to a kernel; `types` are those of numba."""
    arguments = ", ".join([f"a{number}" for number in range(len(types))])
    source = f"def drive({arguments}):\n    kernel({arguments})\n"
    return RuleLoop(kernel.__name__, source, {"kernel": kernel}, f"void({', '.join(types)})")
