"""numba's compiler, without the passes and the machine code that generated modules do not need.

A function that only kernels call, a *part*, becomes code of LLVM that is linked into the kernels.
LLVM optimizes and translates a kernel as a whole, once; numba would do this for each function that
the kernel calls, and for each of these twice. Imports numba, so only `library` imports this module.
"""

# numba has no types of its own.
# pyright: basic
# pyright: reportAttributeAccessIssue=false, reportMissingTypeStubs=false

from __future__ import annotations

from typing import Any, Final

from numba.core.codegen import JITCodeLibrary
from numba.core.compiler import CompilerBase
from numba.core.compiler_machinery import PassManager, register_pass
from numba.core.typed_passes import (
    AnnotateTypes,
    IRLegalization,
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

_FRONT: Final = (
    TranslateByteCode, FixupArgs, IRProcessing, GenericRewrites, ReconstructSSA,
    NopythonTypeInference, PreLowerStripPhis, IRLegalization, AnnotateTypes,
)  # fmt: skip
"""Of numba's passes those for loops, arithmetic, items, calls and errors: no closures, objects,
references to arrays or loops in threads."""


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


@register_pass(mutates_CFG=True, analysis_only=False)
class _KernelLowering(NativeLowering):
    _name = "kernel_lowering"

    def run_pass(self, state: Any) -> bool:
        state.library = _KernelCode(state.targetctx.codegen(), state.func_id.func_qualname)
        state.library.enable_object_caching()
        return super().run_pass(state)


@register_pass(mutates_CFG=True, analysis_only=False)
class _PartLowering(NativeLowering):
    _name = "part_lowering"

    def run_pass(self, state: Any) -> bool:
        state.library = _PartCode(state.targetctx.codegen(), state.func_id.func_qualname)
        state.flags.no_compile = True
        super().run_pass(state)
        # In place of the function for Python: an object by which callers find the part.
        key = [].append
        state.cr = state.cr._replace(cfunc=key)
        state.targetctx.insert_user_function(key, state.cr.fndesc, [state.library])
        return True


class KernelCompiler(CompilerBase):
    """Compiles a kernel, which Python calls."""

    lowering: Any = _KernelLowering

    def define_pipelines(self) -> list[Any]:
        """The passes."""
        made = PassManager("minerva_fast")
        for each in (*_FRONT, self.lowering, NoPythonBackend):
            made.add_pass(each, each.__name__)
        made.finalize()
        return [made]


class PartCompiler(KernelCompiler):
    """Compiles a function that kernels call."""

    lowering = _PartLowering
