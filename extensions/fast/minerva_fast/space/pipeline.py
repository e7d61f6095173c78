"""The compiler of rules: that of numba, with Python's operators and functions, without mixtures.

Two passes over numba's representation of a rule, of which its kernels are already a part: one
replaces operators and functions by those of `operators` and `functions`, the other refuses numbers
that are an int in one case and a real in another. Imports numba, so only compiled rules import this
module.
"""

# numba has no types of its own.
# pyright: basic
# pyright: reportAttributeAccessIssue=false, reportOptionalCall=false, reportPrivateImportUsage=false

from __future__ import annotations

import operator
from collections.abc import Iterator
from pathlib import Path
from types import ModuleType
from typing import Any, Final

from numba.core import ir, ir_utils
from numba.core.compiler import CompilerBase, DefaultPassBuilder
from numba.core.compiler_machinery import AnalysisPass, FunctionPass, register_pass
from numba.core.typed_passes import NopythonTypeInference
from numba.core.untyped_passes import LiteralPropagationSubPipelinePass

from minerva_fast.space.functions import FUNCTIONS
from minerva_fast.space.mixtures import ARITHMETIC, CHOICE, OTHER, refuse_mixtures
from minerva_fast.space.operators import OPERATORS
from minerva_fast.space.turns import count_turns

_SAME_FOR_REALS: Final = (
    operator.truediv, operator.itruediv, operator.lt, operator.le, operator.gt, operator.ge,
    operator.eq, operator.ne,
)  # fmt: skip
"""Operators with the same result for an int and for a real of the same value."""
_BOUNDED: Final = frozenset(
    str(Path(__file__).with_name(f"{name}.py"))
    for name in ("cell_lists", "edges", "field", "lattice", "occupancy")
)
"""Files of kernels whose ints are rows, cells and numbers of such, for any arguments."""
_FOLDED: Final = (min, max)
"""Functions of two numbers or more, of which the replacement has two."""


@register_pass(mutates_CFG=False, analysis_only=False)
class _Replace(FunctionPass):
    """Replaces operators and functions, and counts the turns of loops."""

    _name = "replace_operators"

    def __init__(self) -> None:
        FunctionPass.__init__(self)

    def run_pass(self, state: Any) -> bool:
        """Change the statements of a rule."""
        for block in state.func_ir.blocks.values():
            block.body = [new for old in block.body for new in _replaced(state.func_ir, old)]
        count_turns(state.func_ir, _BOUNDED)
        state.func_ir._definitions = ir_utils.build_definitions(state.func_ir.blocks)
        return True


@register_pass(mutates_CFG=False, analysis_only=True)
class _Refuse(AnalysisPass):
    """Refuses mixtures of ints and reals."""

    _name = "refuse_mixtures"

    def __init__(self) -> None:
        AnalysisPass.__init__(self)

    def run_pass(self, state: Any) -> bool:
        """Raise TypingError for a mixture."""
        refuse_mixtures(state.func_ir, state.typemap)
        return False


def _replaced(function: Any, statement: Any) -> Iterator[Any]:
    """The statements in place of one."""
    value = getattr(statement, "value", None)
    if isinstance(statement, ir.Assign) and isinstance(value, ir.Expr):
        prefix, instead, operands = _instead(function, value)
        if instead is not None:
            first = operands[0]
            for other in operands[1:-1]:
                chosen = _variable(statement, CHOICE)
                yield from _call(statement, prefix, instead, [first, other], chosen)
                first = chosen
            last = [first, *operands[1:][-1:]]
            yield from _call(statement, prefix, instead, last, statement.target)
            return
        named = (
            FUNCTIONS.get(_object(function, statement.target)) if value.op == "getattr" else None
        )
        if named is not None:  # which numba may not know
            statement.value = ir.Global(OTHER, named, statement.loc)
    yield statement


def _call(
    statement: Any, prefix: str, function: Any, operands: list[Any], target: Any
) -> Iterator[Any]:
    called, place = _variable(statement, prefix), statement.loc
    yield ir.Assign(ir.Global(prefix, function, place), called, place)
    yield ir.Assign(ir.Expr.call(called, operands, (), place), target, place)


def _variable(statement: Any, prefix: str) -> Any:
    return ir.Var(statement.target.scope, ir_utils.mk_unique_var(prefix), statement.loc)


def _instead(function: Any, value: Any) -> tuple[str, Any, list[Any]]:
    """What replaces the operator or function of an expression, if anything, and its operands."""
    if value.op in ("binop", "inplace_binop", "unary") and value.loc.filename not in _BOUNDED:
        prefix = OTHER if value.fn in _SAME_FOR_REALS else ARITHMETIC
        operands = [value.value] if value.op == "unary" else [value.lhs, value.rhs]
        return prefix, OPERATORS.get(value.fn), operands
    if value.op == "call" and value.args and not (value.kws or value.vararg):
        called, arguments = _object(function, value.func), list(value.args)
        if (called in _FOLDED and len(arguments) > 1) or called is abs:
            return CHOICE, FUNCTIONS[called], arguments
        return OTHER, FUNCTIONS.get(called), arguments
    return OTHER, None, []


def _object(function: Any, variable: Any) -> Any:
    """The function of a module or of Python that a variable holds; None for others."""
    known = ir_utils.guard(ir_utils.get_definition, function, variable)
    value: Any = None
    if isinstance(known, ir.Global | ir.FreeVar):
        value = known.value
    elif isinstance(known, ir.Expr) and known.op == "getattr":
        owner = _object(function, known.value)
        value = getattr(owner, known.attr, None) if isinstance(owner, ModuleType) else None
    return value if callable(value) or isinstance(value, ModuleType) else None


class RuleCompiler(CompilerBase):
    """Compiles a rule with Python's operators and functions."""

    def define_pipelines(self) -> list[Any]:
        """The passes of numba with those of rules."""
        passes = DefaultPassBuilder.define_nopython_pipeline(self.state)
        passes.add_pass_after(_Replace, LiteralPropagationSubPipelinePass)
        passes.add_pass_after(_Refuse, NopythonTypeInference)
        passes.finalize()
        return [passes]
