"""Statements of compiled functions: assignments, loops, branches, and calls of user code.

What a function returns, and what else it may do, depends on whether it is a method, a rule or
a helper: `results`. A function of user code that is called becomes a helper.
"""

from __future__ import annotations

import ast
import inspect
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import replace
from types import FunctionType
from typing import Any, Final, cast

from minerva_bus.world.class_declaration import NotCompilable
from minerva_fast.draws import TURNS, TURNS_IN_CALL
from minerva_fast.expressions import Expressions
from minerva_fast.functions import Called, bound
from minerva_fast.origin import EXPRESSIONS, STATEMENTS, Origin
from minerva_fast.values import (
    STEP,
    FunctionScope,
    Given,
    Helper,
    Items,
    Known,
    Method,
    Reference,
    RuleGrid,
    RuleTable,
    Slot,
    Value,
    ValueKind,
    both,
    constant,
    indented,
    variable,
)

MAX_ITEMS: Final = 1_000
"""Maximum length of a local list."""
FAULT: Final = "raise ArithmeticError"
_UNCOUNTED: Final = 1000
"""Turns of a loop that take no time."""
_VARIABLE: Final = inspect.CO_VARARGS | inspect.CO_VARKEYWORDS
_ZERO: Final = constant(ValueKind.INT, 0)


class Results:
    """What a function returns and may do: a rule, unless a subclass says otherwise."""

    def returned(self, check: Statements, node: ast.Return) -> list[str]:
        """The lines of a `return`."""
        none = node.value is None or (
            isinstance(node.value, ast.Constant) and node.value.value is None
        )
        if not none:
            raise check.problem(node, "a rule that returns a value", "change a column or cell")
        return ["return"]

    def end(self, check: Statements) -> list[str]:
        """The lines of the end of the source, which can be reached."""
        return []

    def store(self, check: Statements, target: ast.Attribute, value: Value) -> list[str]:
        """The lines of an assignment to an attribute."""
        if not isinstance(target.value, ast.Name):
            check.value(target.value)  # which may have a more precise error
        instead = f"change an item: {ast.unparse(target)}[i] = ..."
        raise check.problem(target, "an assignment to an attribute", instead)

    def emit(self, check: Statements, node: ast.Call) -> list[str] | None:
        """The lines of `moment.emit(...)`; None for other calls."""
        return None


class Statements:
    """Checks and prints the statements of one function."""

    def __init__(self, method: Method, scope: FunctionScope, results: Results) -> None:
        self.method = method
        self.scope = scope
        self.results = results
        self.expressions = Expressions(method, scope, self._helper)
        self.problem = self.expressions.problem
        self.value = self.expressions.value
        self._breaks: list[set[str] | None] = []
        """Of each loop around a statement, the variables that have a value at its breaks."""
        self._checks: Mapping[type[ast.stmt], Callable[[Any], list[str]]] = {
            ast.Assign: self._assign,
            ast.AugAssign: self._augmented,
            ast.AnnAssign: self._annotated,
            ast.Expr: self._expression,
            ast.If: self._if,
            ast.While: self._while,
            ast.For: self._for,
            ast.Return: self._return,
            ast.Pass: lambda node: ["pass"],
            ast.Break: lambda node: self._jump("break"),
            ast.Continue: lambda node: self._jump("continue"),
            # The row runs in Python again, which raises the error with its usual message.
            ast.Raise: lambda node: self._jump(FAULT),
            ast.Assert: lambda node: self.fault_unless(self.expressions.truth(node.test).text),
        }

    # --- blocks and branches ---

    def function(self) -> list[str]:
        """The lines of the function."""
        checked = self.block(self.scope.origin.tree.body)
        reached = self.scope.assigned is not None
        return [*checked, *self.results.end(self)] if reached else checked

    def block(self, nodes: Sequence[ast.stmt]) -> list[str]:
        """The lines of statements; those that are never reached are left out."""
        made = list[str]()
        for node in nodes:
            if self.scope.assigned is None:
                break
            check = self._checks.get(type(node))
            if check is None:
                raise self.problem(node, *STATEMENTS.get(type(node), ("this statement", "")))
            made += check(node)
        return made

    def _return(self, node: ast.Return) -> list[str]:
        made = self.results.returned(self, node)
        self.scope.assigned = None
        return made

    def _jump(self, line: str) -> list[str]:
        if line == "break":
            self._breaks[-1] = both(self._breaks[-1], self.scope.assigned)
        self.scope.assigned = None
        return [line]

    def fault_unless(self, test: str) -> list[str]:
        """A fault if a condition does not hold."""
        return [f"if not ({test}):", *indented([FAULT])]

    def branch(
        self, test: ast.expr, then: Callable[[], list[str]], otherwise: Callable[[], list[str]]
    ) -> list[str]:
        """Two branches, of which each begins with the variables known here."""
        made, before = self.expressions.truth(test), set(self.scope.assigned or ())
        self.scope.assigned = set(before)
        yes, after = then(), self.scope.assigned
        self.scope.assigned = before
        no = otherwise()
        self.scope.assigned = both(after, self.scope.assigned)
        lines: list[str] = [f"if {made.text}:", *indented(yes)]
        return [*lines, "else:", *indented(no)] if no else lines

    def _if(self, node: ast.If) -> list[str]:
        return self.branch(
            node.test, lambda: self.block(node.body), lambda: self.block(node.orelse)
        )

    def _expression(self, node: ast.Expr) -> list[str]:
        if isinstance(node.value, ast.Constant):  # a docstring
            return []
        if not isinstance(node.value, ast.Call):
            what = EXPRESSIONS.get(type(node.value), ("a value that is not used", "remove it"))
            raise self.problem(node, *what)
        emitted = self.results.emit(self, node.value)
        if emitted is not None:
            return emitted
        kind, text = self.expressions.call(node.value)
        return [text if kind is None else f"{self.scope.temporary()} = {text}"]

    # --- assignments ---

    def held(self, value: Value) -> tuple[Value, list[str]]:
        """A value in a variable of the generated function, unless it is one."""
        if value.simple and (value.constant is not None or value.variable):
            return value, []
        name = self.scope.temporary()
        made = replace(variable(value.kind, name), newborn=value.newborn)
        return made, [f"{name} = {value.text}"]

    def _assign(self, node: ast.Assign) -> list[str]:
        single = node.targets[0] if len(node.targets) == 1 else None
        if isinstance(single, ast.Name):
            made = self._named(single, node.value)
            if made is not None:
                return made
        if isinstance(single, ast.Tuple | ast.List):
            return self._unpack(node, single)
        value = self.value(node.value)
        if single is not None:
            return self.store(single, value)
        held, lines = self.held(replace(value, simple=False))
        return [*lines, *(line for target in node.targets for line in self.store(target, held))]

    def _named(self, target: ast.Name, node: ast.expr) -> list[str] | None:
        """An assignment of a list or of another name of an array or table; None for others."""
        if isinstance(node, ast.List | ast.BinOp) and _is_list(node):
            return self._new_list(target, node)
        reference = None
        if isinstance(node, ast.Name | ast.Attribute):
            reference = self.expressions.reference(node)
        if not isinstance(reference, Items | RuleTable | RuleGrid):
            return None
        self._refer(target, reference)
        return []

    def _refer(self, target: ast.Name, reference: Reference) -> None:
        """Let a variable be a name of something."""
        name, scope = target.id, self.scope
        known = scope.references.setdefault(name, reference)
        if known != reference or name in scope.kinds:
            raise self.problem(target, f"another value for {name}", "use another variable")
        scope.aliases.add(name)
        if scope.assigned is not None:
            scope.assigned.add(name)

    def _unpack(self, node: ast.Assign, target: ast.Tuple | ast.List) -> list[str]:
        targets = target.elts
        for each in targets:
            if isinstance(each, ast.Starred):
                raise self.problem(each, *EXPRESSIONS[ast.Starred])
        if isinstance(node.value, ast.Subscript):
            columns = self.expressions.columns(node.value.value, target)
            if columns is not None:
                place = self.expressions.place(node.value, columns[0][1])
                held, made = self.held(place)
                for each, items in columns:
                    made += self.store(each, self.expressions.item_at(items, held.text))
                return made
        if isinstance(node.value, ast.Name):
            grid = self.expressions.reference(node.value)
            if isinstance(grid, RuleGrid):
                what = f"an assignment of {node.value.id} to several names"
                instead = f"write {node.value.id}.{grid.type._fields[0]}"
                raise self.problem(node, what, instead)
        if not isinstance(node.value, ast.Tuple) or len(node.value.elts) != len(targets):
            instead = "write as many values: a, b = b, a"
            raise self.problem(node, "an assignment to several names", instead)
        values = [self.held(replace(self.value(each), simple=False)) for each in node.value.elts]
        made = [line for _, lines in values for line in lines]
        for each, (value, _) in zip(targets, values, strict=True):
            made += self.store(each, value)
        return made

    def _annotated(self, node: ast.AnnAssign) -> list[str]:
        if node.value is None:
            return []
        return self._assign(ast.copy_location(ast.Assign([node.target], node.value), node))

    def _augmented(self, node: ast.AugAssign) -> list[str]:
        if not isinstance(node.target, ast.Subscript):
            old = self.value(_loaded(node.target))
            new = self.expressions.of_values(node, node.op, old, self.value(node.value))
            return self.store(node.target, new)
        # Held, because the index is used twice and may draw a number.
        items, place = self.expressions.place_of(node.target)
        held, lines = self.held(place)
        old = self.expressions.item_at(items, held.text)
        new = self.expressions.of_values(node, node.op, old, self.value(node.value))
        return [*lines, *self._set_item(node.target, items, held, new)]

    def store(self, target: ast.expr, value: Value) -> list[str]:
        """Assign a value to a variable, an attribute, or an item of a list."""
        match target:
            case ast.Name():
                return [self.assign(target, value)]
            case ast.Attribute():
                return self.results.store(self, target, value)
            case ast.Subscript():
                items = self.expressions.items(target.value)
                if items is None and not self.method.rule:
                    instead = "make a list: values = [0.0] * 4"
                    raise self.problem(target, "an assignment to an item of this", instead)
                return self._set_item(target, *self.expressions.place_of(target), value)
            case _:
                instead = "assign to a variable or an attribute"
                raise self.problem(target, "an assignment to this", instead)

    def assign(self, target: ast.Name, value: Value) -> str:
        """Assign to a local variable; its kind is that of all its values."""
        name, scope = target.id, self.scope
        if name in scope.references:
            raise self.problem(target, f"another value for {name}", "use another variable")
        old = scope.kinds.setdefault(name, self.expressions.definite(target, value).kind)
        line = scope.lines.setdefault(name, target.lineno)
        if value.newborn and line == target.lineno:
            scope.newborns.add(name)
        elif name in scope.newborns and not value.newborn:
            raise self.problem(target, f"another value for {name}, a copy", "use another variable")
        if old is not value.kind:
            what = f"{name} is {value.kind.value} here and {old.value} in line {line}"
            raise self.problem(target, what, self.expressions.one_kind(old, value.kind))
        if scope.assigned is not None:
            scope.assigned.add(name)
        return f"v_{name} = {value.text}"

    def _set_item(
        self, target: ast.Subscript, items: Items, place: Value, value: Value
    ) -> list[str]:
        if items.fixed or items.text.startswith("TABLE_"):
            what = f"an assignment to {ast.unparse(target.value)}"
            raise self.problem(target, what, items.fixed or "make a list: values = [0.0] * 4")
        self.expressions.access(target, items, place, writes=True)
        if items.item:
            value = self.expressions.as_number(target, value)
        if items.item == "int16":
            if value.kind is not ValueKind.INT:
                what = "a real in Cells: Cells are ints"
                raise self.problem(target, what, "write int(...), or use Reals")
            value = replace(value, text=f"short({value.text})")
        elif items.item == "real":
            value = self.expressions.as_exact(value)
        elif value.kind is not items.kind:
            what = f"{ast.unparse(target.value)} holds items of one type, {items.kind.value}"
            instead = "use one type, such as 0.0 and float(...)"
            raise self.problem(target, f"{what}; this is {value.kind.value}", instead)
        return [f"{items.text}[{place.text}] = {value.text}"]

    # --- lists of fixed length ---

    def _new_list(self, target: ast.Name, node: ast.List | ast.BinOp) -> list[str]:
        elements, times = node, 1
        if isinstance(node, ast.BinOp):
            elements, times = node.left, self._size(node.right)
        nodes = cast("ast.List", elements).elts
        if not 1 <= len(nodes) * times <= MAX_ITEMS:
            what = f"a list of {len(nodes) * times} items"
            raise self.problem(node, what, f"use 1 to {MAX_ITEMS} items")
        kind, values = self.expressions.alike(node, [self.value(each) for each in nodes])
        items = self._list(target, kind, len(nodes) * times)
        held = [self.held(value) for value in values]
        made = [line for _, lines in held for line in lines]
        if len(held) == 1:
            return [*made, *_filled(items, held[0][0], self.scope.temporary())]
        for index in range(items.size):
            made.append(f"{items.text}[{index}] = {held[index % len(held)][0].text}")
        return made

    def _size(self, node: ast.expr) -> int:
        count = self.value(node)
        if count.constant is None or count.kind is not ValueKind.INT or count.constant < 1:
            what = "a list whose length is not a constant"
            raise self.problem(node, what, "use a constant length")
        return int(count.constant)

    def _list(self, target: ast.Name, kind: ValueKind, size: int) -> Items:
        """The list of a variable."""
        lists = self.method.lists
        self.expressions.definite(target, Value(kind, ""))
        items = Items(f"l_{len(lists)}", kind, str(size), size)
        items = lists.setdefault((id(self.scope), target.id, kind, size), items)
        self._refer(target, items)
        self.expressions.use(items.text)
        return items

    # --- calls of user code ---

    def _helper(
        self, node: ast.Call, function: FunctionType, agent: tuple[Reference, ...]
    ) -> Called:
        if function.__code__.co_flags & _VARIABLE:
            what = f"{function.__name__}, a function with * or **, as decorators make"
            raise self.problem(node, what, "call a function with a parameter for each argument")
        arguments = [*agent, *map(self._argument, node.args)]
        named = {str(word.arg): self._argument(word.value) for word in node.keywords}
        signature = inspect.signature(function)
        given = bound(self.expressions, node, function.__name__, signature, arguments, named)
        given |= {p.name: p.default for p in signature.parameters.values() if p.name not in given}
        given = {parameter: self._plain(node, each) for parameter, each in given.items()}
        made = self._made(node, function, given)
        looped = self.scope.loops > 0
        self.scope.accesses += [replace(a, looped=looped or a.looped) for a in made.accesses]
        passed = [self._passed_on(slot, given).text for slot in made.parameters]
        text = f"{made.name}({', '.join(['progress', 'words', 'i', *passed])})"
        return made.kind, text

    def _passed_on(self, slot: Slot, given: Mapping[str, Any]) -> Value:
        """An argument of a helper: a value of the call, or a variable that the helper reads."""
        name = slot.name.removeprefix("v_")
        if slot.name.startswith("v_") and isinstance(given.get(name), Value):
            value: Value = given[name]
            return value
        return self.expressions.use(slot.name, slot.kind)

    def _argument(self, node: ast.expr) -> Any:
        named = isinstance(node, ast.Name | ast.Attribute)
        reference = self.expressions.reference(node) if named else None
        if reference is not None and not isinstance(reference, Known):
            return reference
        return self.expressions.definite(node, self.value(node))

    def _plain(self, node: ast.Call, value: Any) -> Any:
        """An argument; default values are constants."""
        if value is Given.EVENT:
            raise self.problem(node, "the event as an argument", "pass the data that are needed")
        if isinstance(value, Reference | Value):
            return value
        known = self.expressions.constant_of(value)
        if known is None:
            raise self.problem(node, f"the argument {value!r}", "pass numbers, bools or texts")
        return known

    def _made(self, node: ast.Call, function: FunctionType, given: dict[str, Any]) -> Helper:
        """The helper for arguments of these kinds."""
        method = self.method
        if function in method.calling:
            raise self.problem(node, "a function that calls itself", "write a loop")
        origin = Origin.of(function)
        for name in stored(origin.tree) & given.keys():
            if given[name] is Given.OWN_ROW:
                given[name] = self.expressions.use("v_own")
        values = {name: each.kind for name, each in given.items() if isinstance(each, Value)}
        references = {name: each for name, each in given.items() if name not in values}
        key = function, tuple(values.items()), tuple(references.items())
        if key in method.helpers:
            return method.helpers[key]
        method.calling.append(function)
        scope = FunctionScope(origin, references, dict(values), assigned=set(values))
        lines = Statements(method, scope, HelperResults()).function()
        method.calling.remove(function)
        slots = [Slot(f"v_{name}", scope.kinds[name]) for name in values]
        slots += [Slot(name, each.kind) for name, each in sorted(scope.reads.items())]
        name = f"h{len(method.helpers)}_{function.__name__}"
        made = Helper(name, tuple(slots), scope.result, lines, scope.accesses)
        method.helpers[key] = made
        return made

    # --- loops ---

    def _body(
        self, node: ast.While | ast.For, first: Sequence[str]
    ) -> tuple[list[str], set[str] | None]:
        """The body of a loop, and the variables that have a value at its breaks."""
        if node.orelse:
            instead = "set a bool variable before `break`, and test it after the loop"
            raise self.problem(node, "the `else` of a loop", instead)
        self._breaks.append(None)
        self.scope.loops += 1
        checked = self.block(node.body)
        self.scope.loops -= 1
        return indented([*first, *checked]), self._breaks.pop()

    def _while(self, node: ast.While) -> list[str]:
        endless = isinstance(node.test, ast.Constant) and bool(node.test.value)
        test, before = self.expressions.truth(node.test), set(self.scope.assigned or ())
        body, left = self._body(node, ["turns(progress, 1.0)"])
        self.scope.assigned = left if endless else before
        return [f"while {test.text}:", *body]

    def _for(self, node: ast.For) -> list[str]:
        function = None
        if isinstance(node.iter, ast.Call):
            function = self.expressions.reference(node.iter.func)
            if isinstance(function, Known) and function.value is range:
                return self._for_range(node, node.iter)
        reference = self.expressions.reference(node.iter)
        if isinstance(reference, RuleTable):
            raise self.expressions.whole_table(node.iter, reference.type, "NAME[k]")
        columns = self.expressions.columns(node.iter, node.target)
        if columns is None:
            raise self._no_loop(node.iter)
        counter = self.scope.temporary()
        taken = [(name, self.expressions.item_at(items, counter)) for name, items in columns]
        return self._counted(node, f"for {counter} in range({columns[0][1].size}):", taken)

    def _no_loop(self, node: ast.expr) -> NotCompilable:
        if isinstance(node, ast.Call):
            self.value(node)
        instead = "loop over range(...), a constant tuple or a local list"
        return self.problem(node, "a loop over this", instead)

    def _for_range(self, node: ast.For, call: ast.Call) -> list[str]:
        if call.keywords or not 1 <= len(call.args) <= 3:
            raise self.problem(call, "these arguments of range", "write range(start, stop, step)")
        values = [self.value(argument) for argument in call.args]
        if any(value.kind is not ValueKind.INT for value in values):
            raise self.problem(call, "a range of numbers that are not ints", "write int(...)")
        step = values[2] if len(values) == 3 else constant(ValueKind.INT, 1)
        if not step.constant:
            raise self.problem(call, "a step that is not a constant", "write a number, such as 2")
        ends = [_ZERO, values[0]] if len(values) == 1 else values[:2]
        (start, first), (stop, second) = map(self.held, ends)
        made = [*first, *second]
        numbers = [each.constant for each in ends]
        if None in numbers or (numbers[1] - numbers[0]) / step.constant > _UNCOUNTED:
            distance = f"float64({stop.text}) - float64({start.text})"
            made.append(f"turns(progress, ({distance}) / {step.text})")
        counter = self.scope.temporary()
        head = f"for {counter} in range({start.text}, {stop.text}, {step.text}):"
        return [
            *made,
            *self._counted(node, head, [(node.target, variable(ValueKind.INT, counter))]),
        ]

    def _counted(
        self, node: ast.For, head: str, taken: Sequence[tuple[ast.expr, Value]]
    ) -> list[str]:
        """A loop, with the values that its names take in each turn."""
        # The loop may run zero times; then its names have no value.
        before, first = set(self.scope.assigned or ()), list[str]()
        for target, value in taken:
            if not isinstance(target, ast.Name):
                raise self.problem(target, "a loop over this", "use a name for each value")
            first.append(self.assign(target, value))
        body, _ = self._body(node, first)
        self.scope.assigned = before
        return [head, *body]


class HelperResults(Results):
    """A function that is called: it returns a value, or nothing, and changes no attributes."""

    def returned(self, check: Statements, node: ast.Return) -> list[str]:
        """A value of one kind; nothing if there is no value at any `return`."""
        scope = check.scope
        if node.value is None:
            if scope.result is not None:
                raise check.problem(node, "a function that returns nothing", "return a value")
            return ["return"]
        value = check.expressions.definite(node, check.value(node.value))
        old, scope.result = scope.result or value.kind, value.kind
        if old is not value.kind:
            instead = check.expressions.one_kind(old, value.kind)
            raise check.problem(node, "results of different types", instead)
        return [f"return {value.text}"]

    def end(self, check: Statements) -> list[str]:
        """The end of a function without a result."""
        if check.scope.result is not None:
            what = "a function that returns no value on one path"
            raise check.problem(check.scope.origin.tree, what, "end it with return")
        return []

    def store(self, check: Statements, target: ast.Attribute, value: Value) -> list[str]:
        """Only a method itself changes attributes."""
        what = "a function that changes attributes"
        raise check.problem(target, what, "return the value and assign it in the method")


def _is_list(node: ast.expr) -> bool:
    if isinstance(node, ast.BinOp):
        return isinstance(node.op, ast.Mult) and isinstance(node.left, ast.List)
    return isinstance(node, ast.List)


def _filled(items: Items, value: Value, counter: str) -> list[str]:
    """The lines that set all items of a list to a value."""
    return [
        f"for {counter} in range({items.size}):",
        *indented([f"{items.text}[{counter}] = {value.text}"]),
    ]


def stored(tree: ast.AST) -> set[str]:
    """The names to which a function assigns."""
    names = [node for node in ast.walk(tree) if isinstance(node, ast.Name)]
    return {node.id for node in names if isinstance(node.ctx, ast.Store)}


def _loaded(target: ast.expr) -> ast.expr:
    """The expression that reads what an assignment writes."""
    read = ast.parse(ast.unparse(target), mode="eval").body
    for node in ast.walk(read):
        ast.copy_location(node, target)
    return read


# --- the generated module ---

_MOST_IN_CALL: Final = 50_000_000
"""Turns of loops, a fraction of a second, after which a kernel returns, so that Ctrl-C works."""
FIRST_TURN: Final = f"progress[{TURNS}] = 0"
LAST_TURN: Final = (
    f"progress[{TURNS_IN_CALL}] += progress[{TURNS}]",
    f"if progress[{TURNS_IN_CALL}] > {_MOST_IN_CALL}:",
    f"{STEP}progress[{TURNS_IN_CALL}] = 0",
    f"{STEP}return k + 1",
)
"""The lines before and after a row whose turns are counted."""


def printed_functions(method: Method, row: Iterable[str]) -> str:
    """A module with the functions for a row, whose kernel is missing."""
    lines = [f'"""Generated by minerva_fast from {method.title}."""', ""]
    lines += ["from minerva_fast.library import *", ""]
    called = {"shuffle", "surrounded"} if method.rule else set[str]()
    for name in sorted(called | {function.__name__ for function in method.called}):
        lines.append(f"{name} = of_space({name!r})")
    for key, items in method.tables.items():
        dtype = items.kind.machine.replace("boolean", "bool_")
        lines.append(f"{items.text} = np.array(({', '.join(key[1:])},), np.{dtype})")
    for helper in method.helpers.values():
        names = ["progress", "words", "i", *[slot.name for slot in helper.parameters]]
        lines += ["", "", "@inlined", f"def {helper.name}({', '.join(names)}):"]
        lines += indented(helper.lines or ["pass"])
    return "\n".join([*lines, "", "", *row])


def is_counted(method: Method, body: Iterable[str]) -> bool:
    """Whether the turns of a loop are counted."""
    helpers = (line for helper in method.helpers.values() for line in helper.lines)
    return any("turns(" in line for line in (*body, *helpers))
