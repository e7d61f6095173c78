"""The compiler of rules: that of numba, with Python's operators and functions, without mixtures.

Passes over numba's representation of a rule, of which its kernels are already a part:

- One replaces operators and functions by those of `operators`.
- One counts the turns of `while` loops. Machine code that never ends cannot be interrupted: Python
  notices Ctrl-C between two of its own instructions. So an activation with too many turns leaves
  machine code with an error, and then runs as Python.
- One refuses numbers that are an int in one case and a real in another. Python keeps an int an int,
  and numba makes it a real where another path has a real. The results may differ then: -0 is 0 for
  an int and -0.0 for a real, and a real has 53 bits. Small constants are harmless as long as they
  meet reals only, as in `total = 0` before `total += distance`.

Imports numba, so only compiled rules import this module.
"""

# numba has no types of its own.
# pyright: basic
# pyright: reportAttributeAccessIssue=false, reportOptionalCall=false, reportPrivateImportUsage=false

from __future__ import annotations

import operator
from collections.abc import Collection, Iterable, Iterator, Mapping, Sequence
from pathlib import Path
from types import ModuleType
from typing import Any, Final

from numba import njit
from numba.core import analysis, errors, ir, ir_utils, types
from numba.core.compiler import CompilerBase, DefaultPassBuilder
from numba.core.compiler_machinery import AnalysisPass, FunctionPass, register_pass
from numba.core.typed_passes import NopythonTypeInference
from numba.core.untyped_passes import LiteralPropagationSubPipelinePass

from minerva_fast.space.compiling import TURNS
from minerva_fast.space.kernels import MIXED, OPTIONS
from minerva_fast.space.operators import FUNCTIONS, OPERATORS

ARITHMETIC: Final = "$arithmetic"
CHOICE: Final = "$choice"
OTHER: Final = "$function"
"""Prefixes of variables that hold a replaced operator or function: one whose result depends on
whether a number is an int, one that returns one of its arguments, or another."""

_EXACT: Final = 2**53
_CONSTANTS: Final = (ir.Const, ir.Global, ir.FreeVar)


def refuse_mixtures(function: Any, kinds: Mapping[str, Any]) -> None:
    """Raise TypingError at a mixture; `function` is numba's representation, before its phis end."""
    statements = [each for block in function.blocks.values() for each in block.body]
    assignments = [each for each in statements if isinstance(each, ir.Assign)]
    check = _Check(function, kinds)
    while sum([check.spreads(each) for each in assignments]):  # all of them, each time
        pass
    for each in assignments:
        check.check(each)
    for each in statements:
        if isinstance(each, ir.SetItem):
            check.check_item(each)


class _Check:
    """The variables of a function, and those that are mixed."""

    def __init__(self, function: Any, kinds: Mapping[str, Any]) -> None:
        self._function = function
        self._kinds = kinds
        self._mixed: set[str] = set()

    def spreads(self, statement: Any) -> bool:
        """Whether a statement makes another variable mixed. Raises TypingError."""
        target = statement.target.name
        if target in self._mixed or not isinstance(self._kinds[target], types.Float):
            return False
        checked = isinstance(statement.value, ir.Expr) and statement.value.op == "call"
        for source in self._sources(statement):
            if self._is_mixed(source, statement.loc, checked=checked):
                self._mixed.add(target)
        return target in self._mixed

    def check(self, statement: Any) -> None:
        """Raise TypingError if the result of an expression depends on a mixed operand."""
        value = statement.value
        if isinstance(value, ir.Expr) and value.op == "call":
            self._check_call(value, statement.loc)
        elif isinstance(value, ir.Expr) and value.op == "build_list":
            _refuse_if(len({*map(self._is_real, value.items)}) > 1, statement.loc)
        target = self._kinds[statement.target.name]
        if isinstance(target, types.BaseTuple):
            for source in _copied(value):
                _refuse_if(self._differs(self._kinds[source.name], target), statement.loc)

    def check_item(self, statement: Any) -> None:
        """Raise TypingError if an int is assigned to an item of a list of reals."""
        target = self._kinds[statement.target.name]
        if isinstance(target, types.List):
            real = isinstance(target.dtype, types.Float)
            _refuse_if(real and not self._is_real(statement.value), statement.loc)

    def _check_call(self, call: Any, place: Any) -> None:
        kind = self._kinds[call.func.name]
        if isinstance(kind, types.BoundFunction) and isinstance(kind.this, types.List):
            real = isinstance(kind.this.dtype, types.Float)
            for given in call.args if str(kind.typing_key).endswith(".append") else ():
                _refuse_if(real != self._is_real(given), place)
        mixed = [each.name in self._mixed for each in call.args]
        if call.func.name.startswith(ARITHMETIC) and any(mixed):
            reals = [self._is_real(each) for each in call.args]
            pure = [real and not both for real, both in zip(reals, mixed, strict=True)]
            _refuse_if(not any(pure), place)

    def _sources(self, statement: Any) -> Sequence[Any]:
        """The variables or constants one of which a statement copies."""
        value = statement.value
        if isinstance(value, _CONSTANTS):
            return [value]
        if isinstance(value, ir.Expr) and value.op == "static_getitem":
            made = ir_utils.guard(ir_utils.get_definition, self._function, value.value)
            if isinstance(made, ir.Expr) and made.op == "build_tuple":
                return [made.items[value.index]] if isinstance(value.index, int) else []
        if isinstance(value, ir.Expr) and value.op == "call":
            return list(value.args) if value.func.name.startswith(CHOICE) else []
        return list(_copied(value))

    def _is_mixed(self, source: Any, place: Any, *, checked: bool) -> bool:
        """Whether a value copied to a real may be an int. Raises TypingError for large ints."""
        if not isinstance(source, ir.Var):
            number = type(source.value) is int
            _refuse_if(number and abs(source.value) > _EXACT, place)
            return number
        if self._is_real(source):
            return source.name in self._mixed
        # Functions that choose one of two numbers check an int themselves.
        _refuse_if(not (checked or self._is_small(source)), place)
        return True

    def _is_small(self, variable: Any) -> bool:
        """Whether a real can hold an int exactly, as far as the int's type shows."""
        kind = self._kinds[variable.name]
        if isinstance(kind, types.Boolean) or getattr(kind, "bitwidth", 64) < 64:
            return True
        value = getattr(kind, "literal_value", None)
        if value is None:
            known = ir_utils.guard(ir_utils.get_definition, self._function, variable)
            value = known.value if isinstance(known, _CONSTANTS) else None
        return isinstance(value, int) and abs(value) <= _EXACT

    def _is_real(self, variable: Any) -> bool:
        return isinstance(self._kinds[variable.name], types.Float)

    def _differs(self, left: Any, right: Any) -> bool:
        """Whether two tuples have a real in another place."""
        items = (each.types if isinstance(each, types.BaseTuple) else () for each in (left, right))
        return any(
            isinstance(a, types.Float) != isinstance(b, types.Float)
            for a, b in zip(*items, strict=False)
        )


def _copied(value: Any) -> Iterator[Any]:
    """The variables that an assignment copies."""
    sources: Iterable[Any] = ()
    if isinstance(value, ir.Var):
        sources = [value]
    elif isinstance(value, ir.Expr) and value.op == "phi":
        sources = value.incoming_values
    elif isinstance(value, ir.Expr) and value.op == "cast":
        sources = [value.value]
    return (each for each in sources if isinstance(each, ir.Var))


def _refuse_if(mixture: bool, place: Any) -> None:
    if mixture:
        raise errors.TypingError(MIXED, loc=place)


MOST_TURNS: Final = 1_000_000_000
"""A second or more of machine code."""
_ENDLESS: Final = "a loop of a rule has a billion turns"


@njit(**OPTIONS)
def _turn(progress: Any) -> None:
    progress[TURNS] += 1
    if progress[TURNS] > MOST_TURNS:
        raise RuntimeError(_ENDLESS)


def count_turns(function: Any, bounded: Collection[str]) -> None:
    """Count the turns in numba's representation of a function with the argument `progress`.

    Args:
        function: the representation, which is changed.
        bounded: files whose loops are known to end.

    """
    blocks = function.blocks
    arguments = [each for block in blocks.values() for each in block.find_insts(ir.Assign)]
    progress = [
        each.target
        for each in arguments
        if isinstance(each.value, ir.Arg) and each.value.name == "progress"
    ]
    if not progress:
        return
    for loop in analysis.compute_cfg_from_blocks(blocks).loops().values():
        block = blocks[loop.header]
        place = block.body[0].loc
        # A `for` loop of a rule has as many turns as its range, list or array.
        if place.filename not in bounded and not any(block.find_exprs("iternext")):
            scope = progress[0].scope
            called, nothing = (
                ir.Var(scope, ir_utils.mk_unique_var(name), place) for name in ("turn", "counted")
            )
            block.body[:0] = [
                ir.Assign(ir.Global("turn", _turn, place), called, place),
                ir.Assign(ir.Expr.call(called, progress, (), place), nothing, place),
            ]


_SAME_FOR_REALS: Final = (
    operator.truediv, operator.itruediv, operator.lt, operator.le, operator.gt, operator.ge,
    operator.eq, operator.ne,
)  # fmt: skip
"""Operators with the same result for an int and for a real of the same value."""
_BOUNDED: Final = frozenset(
    str(Path(__file__).with_name(f"{name}.py")) for name in ("places", "tables")
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
