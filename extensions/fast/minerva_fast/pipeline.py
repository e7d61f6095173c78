"""numba's compiler, without the modules and passes that generated modules do not need.

numba loads all that it supports, such as linear algebra and random numbers, before it compiles or
loads a function. This is a target of its own, which has numbers, arrays and loops only.

A function that only kernels call, a *part*, becomes code of LLVM that is linked into the kernels.
LLVM optimizes and translates a kernel as a whole, once; numba would do this for each function that
the kernel calls, and for each of these twice. A kernel becomes an object file, and has no names
that other kernels see.
"""

# numba has no types of its own.
# pyright: basic
# pyright: reportAttributeAccessIssue=false, reportMissingTypeStubs=false

from __future__ import annotations

import sys
from functools import cached_property
from types import FunctionType
from typing import Any, Final, cast

from llvmlite.binding import ObjectFileRef  # pyright: ignore
from numba import _dynfunc
from numba.core.codegen import JITCodeLibrary
from numba.core.compiler import CompilerBase, Flags, compile_extra
from numba.core.compiler_lock import global_compiler_lock
from numba.core.cpu import CPUContext, CPUTargetOptions
from numba.core.registry import CPUDispatcher, CPUTarget
from numba.core.sigutils import normalize_signature
from numba.core.target_extension import (
    CPU,
    dispatcher_registry,
    jit_registry,
    target_override,
    target_registry,
)
from numba.core.typed_passes import (
    NativeLowering,
    NoPythonBackend,
    NopythonTypeInference,
    PreLowerStripPhis,
)
from numba.core.typing.context import Context
from numba.core.untyped_passes import (
    FixupArgs,
    GenericRewrites,
    IRProcessing,
    ReconstructSSA,
    TranslateByteCode,
)

OPTIONS: Final = {
    "nopython": True, "error_model": "python", "fastmath": False, "_nrt": False,
    "no_cfunc_wrapper": True,
}  # fmt: skip
"""Python's errors, such as ZeroDivisionError, and sums in the order of the source, so that machine
code has the bits of Python.

Without numba's runtime (NRT), code cannot create arrays and does not count references to them. Each
inlined function counted those to all of its arrays, which took up to six times as long as its
work."""


class _Types(Context):
    """The types of numbers and arrays."""

    def load_additional_registries(self) -> None:
        from numba.core.typing import mathdecl, npydecl

        for each in (mathdecl, npydecl):
            self.install_registry(each.registry)


class _Code(CPUContext):
    """What the operations of numbers and arrays are in LLVM."""

    def load_additional_registries(self) -> None:
        from numba.cpython import mathimpl, numbers, rangeobj, tupleobj  # noqa: F401 (they register)
        from numba.np import arrayobj, npyimpl  # noqa: F401

        for each in (mathimpl, npyimpl):
            self.install_registry(each.registry)

    def post_lowering(self, mod: Any, library: Any) -> None:
        """Leave out numba's runtime."""


class _Target(CPUTarget):
    @cached_property
    def _toplevel_typing_context(self) -> Context:
        return _Types()

    @cached_property
    def _toplevel_target_context(self) -> CPUContext:
        return _Code(self.typing_context, _NAME)


class _Machine(CPU):
    """The processor, for numba's registries of targets."""


# Another one if this module is imported again: numba refuses a second target of one name.
_NAME: Final = f"minerva{len(target_registry)}"
target_registry[_NAME] = _Machine
_TARGET: Final = _Target(_NAME)


class _UnfinishedCode(JITCodeLibrary):
    """Code that is linked, optimized and translated with that of a kernel, or is that kernel."""

    def _optimize_functions(self, ll_module: Any) -> None:
        """Optimize each function, with the same passes: they take longer to make than to run."""
        ll_module.data_layout = self._codegen._data_layout
        manager, builder = self._codegen._function_pass_manager()
        for function in ll_module.functions:
            if not function.is_declaration:
                manager.run(function, builder)

    def _optimize_final_module(self) -> None:
        """Leave it to the optimization of the whole."""

    def _finalize_final_module(self) -> None:
        self._finalized = True


class _Lowering(NativeLowering):
    def run_pass(self, state: Any) -> bool:
        state.library = _UnfinishedCode(state.targetctx.codegen(), state.func_id.func_qualname)
        state.flags.no_compile = True
        super().run_pass(state)
        # In place of the function for Python: an object by which callers find a part.
        key = [].append
        state.cr = state.cr._replace(cfunc=key)
        state.targetctx.insert_user_function(key, state.cr.fndesc, [state.library])
        return True


_PASSES: Final = (
    TranslateByteCode, FixupArgs, IRProcessing, GenericRewrites, ReconstructSSA,
    NopythonTypeInference, PreLowerStripPhis, _Lowering, NoPythonBackend,
)  # fmt: skip
"""Of numba's passes those for loops, arithmetic, items, calls and errors: no closures, objects,
ends of references, or loops in threads."""


class _Compiler(CompilerBase):
    """Compiles a function; as its own pipeline, without checks between passes."""

    pipeline_name: Final = "minerva_fast"
    exec_times: Final[dict[str, Any]] = {}

    def define_pipelines(self) -> list[Any]:
        """The pipelines."""
        return [self]

    def run(self, state: Any) -> None:
        """Run all passes."""
        state.type_annotation = None
        for each in _PASSES:
            each().run_pass(state)


class Part(CPUDispatcher):
    """A function that only kernels call, compiled for the types of each call."""

    targetdescr = _TARGET

    def __init__(self, function: FunctionType, **options: Any) -> None:
        inner = {**OPTIONS, "no_cpython_wrapper": True, **options}
        super().__init__(function, targetoptions=inner, pipeline_class=_Compiler)


dispatcher_registry[_Machine] = Part
jit_registry[_Machine] = lambda **_: Part


@global_compiler_lock
def object_file(function: FunctionType, signature: Any) -> bytes:
    """The machine code of a kernel, which has the name of its module."""
    arguments, result = normalize_signature(signature)
    flags, context, compiler = Flags(), _TARGET.target_context, cast("Any", _Compiler)
    CPUTargetOptions.parse_as_flags(flags, {**OPTIONS, "nogil": True})
    with target_override(_NAME):
        made = compile_extra(
            _TARGET.typing_context, context, function, arguments, result, flags, {}, None, compiler
        )
    assert not made.environment.consts, "code that refers to objects of this process"
    made.library.finalize()
    made.library._verify_declare_only_symbols()
    module, codegen = made.library._final_module, context.codegen()
    names = {
        made.fndesc.llvm_cpython_wrapper_name: function.__module__,
        context.get_env_name(made.fndesc): _environment(function.__module__),
    }
    for each in (*module.functions, *module.global_variables):
        if each.name in names:
            each.name = names[each.name]
        elif not each.is_declaration:
            each.linkage = "internal"
    manager, builder = codegen._module_pass_manager()
    manager.run(module, builder)
    return codegen._tm.emit_object(module)


@global_compiler_lock
def loaded(name: str, code: bytes) -> Any:
    """The function of an object file, for Python."""
    codegen = _TARGET.target_context.codegen()
    engine = codegen._engine._ee
    engine.add_object_file(ObjectFileRef.from_data(code))
    engine.finalize_object()
    environment = _dynfunc.Environment({})
    codegen.set_env(_environment(name), environment)
    address = engine.get_function_address(name)
    return _dynfunc.make_function(
        sys.modules[__name__], "run", "", address, environment, (codegen,)
    )


def machine() -> str:
    """The processor for which the object files are."""
    return repr(_TARGET.target_context.codegen().magic_tuple())


def _environment(name: str) -> str:
    """The variable of an object file that refers to an object of numba's, which code asks for."""
    return f"{name}_environment"
