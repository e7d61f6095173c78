"""Refuses numbers of a rule that are an int in one case and a real in another.

Python keeps an int an int, and numba makes it a real where another path has a real. The results
may differ then: -0 is 0 for an int and -0.0 for a real, and a real has 53 bits. Small constants are
harmless as long as they meet reals only, as in `total = 0` before `total += distance`. Imports
numba, so only compiled rules import this module.
"""

# numba has no types of its own.
# pyright: basic
# pyright: reportAttributeAccessIssue=false, reportOptionalCall=false, reportPrivateImportUsage=false

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from typing import Any, Final

from numba.core import errors, ir, ir_utils, types

from minerva_fast.space.guarded import MIXED

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
