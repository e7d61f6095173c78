"""Compiled methods of a class: checked when the class is made, compiled when they first run.

What checks and compiles is imported by a class with compiled methods: each process of a world would
otherwise import it, and most worlds do not need it.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from minerva_bus.compiled.form import Program
    from minerva_bus.compiled.method import CheckedMethod

Kernel = Callable[..., int]


class CompiledMethods:
    """The compiled methods of an agent class by event type.

    Constants of the module are part of the machine code. If one of them has changed, the methods
    are checked and compiled again.
    """

    def __init__(
        self, cls: Any, methods: Mapping[str, Callable[..., Any]], together: frozenset[str]
    ) -> None:
        self._cls = cls
        self._methods = dict(methods)
        self._together = together
        self._checked = self._check()
        self._kernels: dict[str, Kernel] = {}

    def _check(self) -> dict[str, CheckedMethod]:
        from minerva_bus.compiled.method import checked_methods

        return checked_methods(self._cls, self._methods, self._together)

    def __contains__(self, event_type: object) -> bool:
        return event_type in self._methods

    def __iter__(self) -> Any:
        return iter(sorted(self._methods))

    def __len__(self) -> int:
        return len(self._methods)

    def program(self, event_type: str) -> Program:
        """The checked form of the method for an event type. Raises NotCompilable."""
        if not all(checked.current for checked in self._checked.values()):
            self._checked = self._check()
            self._kernels = {}
        return self._checked[event_type].program

    def kernel(self, event_type: str) -> tuple[Program, Kernel]:
        """The program and the machine code of the method for an event type.

        Raises NotCompilable, and MisuseError without numba.
        """
        program = self.program(event_type)
        kernel = self._kernels.get(event_type)
        if kernel is None:
            # Here, because numba is optional and takes a third of a second to import.
            from minerva_bus.compiled.loading import load_kernel
            from minerva_bus.compiled.writing import written

            kernel = self._kernels[event_type] = load_kernel(written(program))
        return program, kernel


class CompiledViews(CompiledMethods):
    """The compiled views of an agent class by event type."""

    def __init__(self, cls: Any, views: Mapping[str, Callable[..., Any]]) -> None:
        super().__init__(cls, views, frozenset())

    def _check(self) -> dict[str, CheckedMethod]:
        from minerva_bus.compiled.views import checked_views

        return checked_views(self._cls, self._methods)
