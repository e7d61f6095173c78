"""numba's compiler, without the passes and the machine code that generated modules do not need.

A function that only kernels call, a *part*, becomes code of LLVM that is linked into the kernels.
LLVM optimizes and translates a kernel as a whole, once; numba would do this for each function that
the kernel calls, and for each of these twice. Imports numba, so only `library` imports this module.
"""

# numba has no types of its own.
# pyright: basic
# pyright: reportAttributeAccessIssue=false, reportMissingTypeStubs=false

from __future__ import annotations

from functools import cache
from operator import getitem, setitem
from typing import Any, Final

from numba.core import types
from numba.core.codegen import JITCodeLibrary
from numba.core.compiler import CompilerBase
from numba.core.datamodel.models import OpaqueModel
from numba.core.registry import cpu_target
from numba.core.typed_passes import (
    NativeLowering,
    NoPythonBackend,
    NopythonTypeInference,
    PreLowerStripPhis,
)
from numba.core.untyped_passes import (
    FixupArgs,
    GenericRewrites,
    IRProcessing,
    ReconstructSSA,
    TranslateByteCode,
)
from numba.extending import register_model


class _Function(types.Function):
    """A function that numba has, which computes the type of each result once."""

    def __init__(self, templates: Any) -> None:
        super().__init__(templates)
        self._results: dict[Any, Any] = {}

    def get_call_type(self, context: Any, args: Any, kws: Any) -> Any:
        key = tuple(args), tuple(kws.items())
        if key not in self._results:
            self._results[key] = super().get_call_type(context, args, kws)
        return self._results[key]


register_model(_Function)(OpaqueModel)


@cache  # numba forgets types that nobody refers to
def _known(function: types.Function) -> _Function:
    made = _Function(function.templates)
    made._impl_keys = function._impl_keys
    return made


class _Types:
    """numba's types. It tries all forms of an operator for each use; here it does so once."""

    def __init__(self, context: Any) -> None:
        self._context = context

    def __getattr__(self, name: str) -> Any:
        return getattr(self._context, name)

    def resolve_value_type(self, value: Any) -> Any:
        known = self._context.resolve_value_type(value)
        return _known(known) if type(known) is types.Function else known

    def resolve_function_type(self, function: Any, args: Any, kws: Any) -> Any:
        if function is getitem:
            function = self.resolve_value_type(getitem)
        if isinstance(function, _Function):
            return function.get_call_type(self, args, kws)
        return self._context.resolve_function_type(function, args, kws)

    def resolve_getitem(self, value: Any, index: Any) -> Any:
        return self.resolve_function_type(getitem, (value, index), {})

    def resolve_setitem(self, target: Any, index: Any, value: Any) -> Any:
        return self.resolve_value_type(setitem).get_call_type(self, (target, index, value), {})


_TYPES: Final = _Types(cpu_target.typing_context)


class _KernelCode(JITCodeLibrary):
    def _optimize_functions(self, ll_module: Any) -> None:
        """Optimize each function, with the same passes: they take longer to make than to run."""
        ll_module.data_layout = self._codegen._data_layout
        manager, builder = self._codegen._function_pass_manager()
        for function in ll_module.functions:
            if not function.is_declaration:
                manager.run(function, builder)

    def _optimize_final_module(self) -> None:
        manager, builder = self._codegen._module_pass_manager()
        manager.run(self._final_module, builder)


class _PartCode(_KernelCode):
    def _optimize_final_module(self) -> None:
        """Leave it to the optimization of the whole."""

    def _finalize_final_module(self) -> None:
        self._finalized = True


class _KernelLowering(NativeLowering):
    def run_pass(self, state: Any) -> bool:
        state.library = _KernelCode(state.targetctx.codegen(), state.func_id.func_qualname)
        state.library.enable_object_caching()
        return super().run_pass(state)


class _PartLowering(NativeLowering):
    def run_pass(self, state: Any) -> bool:
        state.library = _PartCode(state.targetctx.codegen(), state.func_id.func_qualname)
        state.flags.no_compile = True
        super().run_pass(state)
        # In place of the function for Python: an object by which callers find the part.
        key = [].append
        state.cr = state.cr._replace(cfunc=key)
        state.targetctx.insert_user_function(key, state.cr.fndesc, [state.library])
        return True


_FRONT: Final = (
    TranslateByteCode, FixupArgs, IRProcessing, GenericRewrites, ReconstructSSA,
    NopythonTypeInference, PreLowerStripPhis,
)  # fmt: skip
"""Of numba's passes those for loops, arithmetic, items, calls and errors: no closures, objects,
ends of references, or loops in threads."""


class KernelCompiler(CompilerBase):
    """Compiles a kernel, which Python calls; as its own pipeline, without checks between passes."""

    lowering: Any = _KernelLowering
    pipeline_name: Final = "minerva_fast"
    exec_times: Final[dict[str, Any]] = {}

    def __init__(self, *given: Any) -> None:
        super().__init__(*given)
        self.state.typingctx = self.state.targetctx.typing_context = _TYPES

    def define_pipelines(self) -> list[Any]:
        """The pipelines."""
        return [self]

    def run(self, state: Any) -> None:
        """Run all passes."""
        state.type_annotation = None
        for each in (*_FRONT, self.lowering, NoPythonBackend):
            each().run_pass(state)


class PartCompiler(KernelCompiler):
    """Compiles a function that kernels call."""

    lowering = _PartLowering
