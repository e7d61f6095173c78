"""Statements of a compiled method: control flow, assignments, and functions that it calls."""

from __future__ import annotations

import ast
import inspect
from collections.abc import Callable, Mapping, Sequence
from types import FunctionType
from typing import Any, Final, cast

from minerva_bus.compiled.form import (
    Assign,
    Call,
    Constant,
    Count,
    Expression,
    Finish,
    Helper,
    If,
    Item,
    Jump,
    ListSlot,
    SetItem,
    Slot,
    Statement,
    ValueKind,
    Variable,
    While,
)
from minerva_bus.compiled.names import (
    ROW,
    STATE,
    WORDS,
    AgentItself,
    BoundMethod,
    EventItself,
    Known,
    LocalNames,
    Method,
    Reference,
    joined,
)
from minerva_bus.compiled.origin import Origin
from minerva_bus.compiled.outputs import Outputs
from minerva_bus.compiled.refused import STATEMENTS
from minerva_bus.grammar.types import Type

MAX_ITEMS: Final = 1_000
"""Maximum length of a local list."""

_PASSES: Final = 10
"""Passes over a function until the kinds of its variables are known: each may change once."""


class Statements(Outputs):
    """Checks the statements of one function."""

    def __init__(self, method: Method, scope: LocalNames) -> None:
        super().__init__(method, scope)
        self._breaks: list[set[str] | None] = []
        """Of each loop around a statement, the variables that have a value at its breaks."""

    def _checks_of_statements(self) -> Mapping[type[ast.AST], Callable[[Any], list[Statement]]]:
        return {
            ast.Assign: self._assign,
            ast.AugAssign: self._augmented,
            ast.AnnAssign: self._annotated,
            ast.Expr: self._expression,
            ast.If: self._if,
            ast.While: self._while,
            ast.For: self._for,
            ast.Return: self._return,
            ast.Pass: lambda node: [Jump.PASS],
            ast.Break: lambda node: self._jump(node, Jump.BREAK),
            ast.Continue: lambda node: self._jump(node, Jump.CONTINUE),
            # The row runs in Python again, which raises the error with its usual message.
            ast.Raise: lambda node: self._fault(),
            ast.Assert: self._assert,
        }

    def function(self) -> list[Statement]:
        """The statements of the function, once the kinds of its variables are known."""
        body = self.scope.origin.tree.body
        parameters = set(self.scope.assigned or ())
        for _ in range(_PASSES):
            known = dict(self.scope.kinds), self.scope.result, dict(self.method.kinds)
            self.scope.assigned = set(parameters)
            self.scope.litters, self._repeated = {}, set()
            self.scope.names = iter(range(1_000_000))
            outputs = len(self.method.outputs)
            checked = self.block(body)
            reached = self._reached()
            if known == (self.scope.kinds, self.scope.result, self.method.kinds):
                return [*checked, *self._end(reached)]
            if not self.scope.helper:
                del self.method.outputs[outputs:]
        raise AssertionError("the kinds of variables have not settled")

    def _reached(self) -> bool:
        return self.scope.assigned is not None

    def _end(self, reached: bool) -> list[Statement]:
        """The end of the function's source, if it can be reached."""
        if not reached:
            return []
        if self.scope.helper:
            raise self.problem(
                self.scope.origin.tree,
                "a function that returns no value on one path",
                "end it with return",
            )
        return [Finish(True, ())]

    def block(self, nodes: Sequence[ast.stmt]) -> list[Statement]:
        """The checked form of statements; those that are never reached are left out."""
        checks, made = self._checks_of_statements(), list[Statement]()
        for node in nodes:
            if self.scope.assigned is None:
                break
            check = checks.get(type(node))
            if check is None:
                raise self.problem(node, *STATEMENTS.get(type(node), ("this statement", "")))
            made += check(node)
        return made

    # --- assignments ---

    def _assign(self, node: ast.Assign) -> list[Statement]:
        if len(node.targets) == 1 and isinstance(node.targets[0], ast.Name):
            name = node.targets[0]
            if isinstance(node.value, ast.List | ast.BinOp) and self._is_list(node.value):
                return self._new_list(name, node.value)
            if self._is_litter(node.value):
                return self._collect(name, node.value)
        if len(node.targets) == 1 and isinstance(node.targets[0], ast.Tuple | ast.List):
            return self._unpack(node, node.targets[0].elts)
        value = self.value(node.value)
        if len(node.targets) == 1:
            return self.store(node.targets[0], value)
        held, statement = self._held(value)
        return [statement, *(s for target in node.targets for s in self.store(target, held))]

    def _unpack(self, node: ast.Assign, targets: Sequence[ast.expr]) -> list[Statement]:
        if not isinstance(node.value, ast.Tuple) or len(node.value.elts) != len(targets):
            raise self.problem(
                node, "an assignment to several names", "write as many values: a, b = b, a"
            )
        held = [self._held(self.value(each)) for each in node.value.elts]
        made = [statement for _, statement in held]
        for target, (value, _) in zip(targets, held, strict=True):
            made += self.store(target, value)
        return made

    def _annotated(self, node: ast.AnnAssign) -> list[Statement]:
        if node.value is None:
            return []
        return self._assign(ast.copy_location(ast.Assign([node.target], node.value), node))

    def _augmented(self, node: ast.AugAssign) -> list[Statement]:
        target = node.target
        if isinstance(target, ast.Name) and target.id in self.scope.litters:
            whole = ast.BinOp(ast.Name(target.id, ast.Load()), node.op, node.value)
            return self._collect(target, ast.copy_location(whole, node))
        if isinstance(target, ast.Subscript):
            return self._augmented_item(node, target)
        return self.store(target, self._sum(node, self.value(_loaded(target))))

    def _sum(self, node: ast.AugAssign, old: Expression) -> Expression:
        """The new value of `target += value`, or with another operator."""
        return self.of_values(node, node.op, old, self.value(node.value))

    def _augmented_item(self, node: ast.AugAssign, target: ast.Subscript) -> list[Statement]:
        known = self._own_list(target)
        # Held, because the index is used twice and may draw a number.
        index, statement = self._held(self.index(target, known.length))
        old = Item(known.kind, f"l_{known.name}", known.length, index)
        return [statement, self._set_item(target, known, index, self._sum(node, old))]

    def store(self, target: ast.expr, value: Expression) -> list[Statement]:
        """Assign a value to a variable, an attribute, or an item of a list."""
        if isinstance(target, ast.Name):
            return [self.assign(target, value)]
        if isinstance(target, ast.Attribute):
            return [self._store_attribute(target, value)]
        if isinstance(target, ast.Subscript):
            return [self._store_item(target, value)]
        raise self.problem(target, "an assignment to this", "assign to a variable or an attribute")

    def assign(self, target: ast.Name, value: Expression) -> Statement:
        """Assign to a local variable; its kind is that of all its values."""
        name, scope = target.id, self.scope
        if name in scope.references or name in scope.lists or name in scope.litters:
            raise self.problem(target, f"another value for {name}", "use another variable")
        scope.lines.setdefault((name, value.kind), target.lineno)
        kind = joined(scope.kinds.get(name, value.kind), value.kind)
        if kind is None:
            old = scope.kinds[name]
            line = scope.lines.get((name, old), target.lineno)
            raise self.problem(
                target,
                f"{name} is {value.kind.value} here and {old.value} in line {line}",
                "use two variables",
            )
        scope.kinds[name] = kind
        if scope.assigned is not None:
            scope.assigned.add(name)
        return Assign(f"v_{name}", self.as_mixed(value) if kind is ValueKind.MIXED else value)

    def _store_attribute(self, target: ast.Attribute, value: Expression) -> Statement:
        name, method = target.attr, self.method
        if not isinstance(self.reference(target.value), AgentItself):
            raise self.problem(target, "an assignment to this", "change attributes of self only")
        if self.scope.helper:
            raise self.problem(
                target, "a method that changes attributes", "return the value and assign it there"
            )
        if name not in method.types:
            if name.startswith("_"):
                raise self.problem(target, "a temporary attribute", "use a local variable")
            self.value(target)
            raise self.problem(target, f"an assignment to self.{name}", "declare the attribute")
        method.writes[name] = None
        method.reads[name] = None
        return Assign(f"a_{name}", self._fitting(target, name, method.types[name], value))

    def _fitting(self, node: ast.AST, name: str, declared: Type, value: Expression) -> Expression:
        """A value of an attribute's kind; the attribute is MIXED once it is set to an int."""
        kind = self.method.kinds[name]
        if kind.number and declared.kind == "real" and value.kind.number:
            if value.kind is not ValueKind.REAL:
                # Python keeps the int until the end of the frame.
                self.method.kinds[name] = ValueKind.MIXED
                line: int = getattr(node, "lineno", 0)
                self.method.int_lines.setdefault(f"a_{name}", line)
            return self.as_mixed(value)
        return self.declared(node, name, declared, value)

    def _own_list(self, target: ast.Subscript) -> ListSlot:
        node = target.value
        if not isinstance(node, ast.Name) or node.id not in self.scope.lists:
            raise self.problem(
                target, "an assignment to an item of this", "make a list: values = [0.0] * 4"
            )
        return self.scope.lists[node.id]

    def _store_item(self, target: ast.Subscript, value: Expression) -> Statement:
        known = self._own_list(target)
        return self._set_item(target, known, self.index(target, known.length), value)

    def _set_item(
        self, target: ast.Subscript, known: ListSlot, index: Expression, value: Expression
    ) -> Statement:
        if value.kind is not known.kind:
            raise self.problem(
                target,
                f"{known.name} holds items of one type, {known.kind.value}; this is"
                f" {value.kind.value}",
                "use one type, such as 0.0 and float(...)",
            )
        return SetItem(f"l_{known.name}", known.length, index, value)

    # --- lists of fixed length ---

    def _is_list(self, node: ast.expr) -> bool:
        return isinstance(node, ast.List) or (
            isinstance(node, ast.BinOp)
            and isinstance(node.op, ast.Mult)
            and isinstance(node.left, ast.List)
        )

    def _new_list(self, target: ast.Name, node: ast.List | ast.BinOp) -> list[Statement]:
        items, times = node, 1
        if isinstance(node, ast.BinOp):
            count = self.value(node.right)
            if (
                not isinstance(count, Constant)
                or count.kind is not ValueKind.INT
                or count.value < 1
            ):
                raise self.problem(
                    node.right, "a list whose length is not a constant", "use a constant length"
                )
            items, times = node.left, int(count.value)
        elements = cast("ast.List", items).elts
        if self.scope.helper:
            raise self.problem(node, "a list within a helper", "make the list in the method")
        if not 1 <= len(elements) * times <= MAX_ITEMS:
            raise self.problem(
                node, f"a list of {len(elements) * times} items", f"use 1 to {MAX_ITEMS} items"
            )
        kind, values = self.alike(node, [self.value(each) for each in elements])
        if kind is ValueKind.MIXED:
            raise self.mixed(node)
        name, length = target.id, len(elements) * times
        slot = ListSlot(name, kind, length)
        if self.scope.lists.setdefault(name, slot) != slot or name in self.scope.kinds:
            raise self.problem(target, f"another value for {name}", "use another variable")
        held = [self._held(value) for value in values]
        made = [statement for _, statement in held]
        for index in range(length):
            value = held[index % len(held)][0]
            made.append(SetItem(f"l_{name}", length, Constant(ValueKind.INT, index), value))
        return made

    # --- control flow ---

    def _fault(self) -> list[Statement]:
        self.scope.assigned = None
        return [Jump.FAULT]

    def _assert(self, node: ast.Assert) -> list[Statement]:
        return [If(self.truth(node.test), (), (Jump.FAULT,))]

    def _if(self, node: ast.If) -> list[Statement]:
        test, before = self.truth(node.test), self.scope.assigned
        self.scope.assigned = set(before or ())
        then = self.block(node.body)
        after_then = self.scope.assigned
        self.scope.assigned = set(before or ())
        otherwise = self.block(node.orelse)
        self.scope.assigned = _both(after_then, self.scope.assigned)
        return [If(test, then, otherwise)]

    def _jump(self, node: ast.AST, jump: Jump) -> list[Statement]:
        if jump is Jump.BREAK:
            left = self._breaks[-1]
            self._breaks[-1] = _both(left, self.scope.assigned)
        self.scope.assigned = None
        return [jump]

    def _loop(self, body: Sequence[ast.stmt], *, endless: bool = False) -> list[Statement]:
        """The body of a loop, which may run any number of times; `endless`: until a break."""
        before = set(self.scope.assigned or ())
        self._breaks.append(None)
        self.scope.loops += 1
        checked = self.block(body)
        self.scope.loops -= 1
        left = self._breaks.pop()
        self.scope.assigned = left if endless else _both(before, left)
        return checked

    def _while(self, node: ast.While) -> list[Statement]:
        self._no_else(node)
        endless = isinstance(node.test, ast.Constant) and bool(node.test.value)
        test = self.truth(node.test)
        return [While(test, self._loop(node.body, endless=endless))]

    def _no_else(self, node: ast.While | ast.For) -> None:
        if node.orelse:
            raise self.problem(node, "else after a loop", "use a bool variable and if")

    def _for(self, node: ast.For) -> list[Statement]:
        self._no_else(node)
        if isinstance(node.iter, ast.Call):
            function = self.reference(node.iter.func)
            if isinstance(function, Known) and function.value is range:
                return self._for_range(node, node.iter)
        if isinstance(self.reference(node.iter), EventItself):
            return self._for_events(node)
        sequence = None
        if isinstance(node.iter, ast.Name | ast.Attribute):
            sequence = self.sequence(node.iter)
        if sequence is None:
            self._refuse_iteration(node)
        return self._for_items(node, cast("tuple[str, ValueKind, int]", sequence))

    def _refuse_iteration(self, node: ast.For) -> None:
        if isinstance(node.iter, ast.Call):
            self.value(node.iter)
        raise self.problem(
            node.iter,
            "a loop over this",
            "loop over range(...), a constant tuple, a local list or a batch of events",
        )

    def _for_range(self, node: ast.For, call: ast.Call) -> list[Statement]:
        if call.keywords or not 1 <= len(call.args) <= 3:
            raise self.problem(call, "these arguments of range", "write range(start, stop, step)")
        values = [self.value(argument) for argument in call.args]
        if any(value.kind is not ValueKind.INT for value in values):
            raise self.problem(call, "a range of numbers that are no ints", "write int(...)")
        step = values[2] if len(values) == 3 else Constant(ValueKind.INT, 1)
        if not isinstance(step, Constant) or step.value == 0:
            raise self.problem(call, "a step that is not a constant", "write a number, such as 2")
        start, stop = (Constant(ValueKind.INT, 0), values[0]) if len(values) == 1 else values[:2]
        counter = self.scope.temporary()
        return self._counted(
            node, counter, start, stop, int(step.value), Variable(ValueKind.INT, counter)
        )

    def _counted(
        self,
        node: ast.For,
        counter: str,
        start: Expression,
        stop: Expression,
        step: int,
        value: Expression,
    ) -> list[Statement]:
        before = set(self.scope.assigned or ())
        target = self._target(node)
        first = self.assign(target, value)
        body = self._loop(node.body)
        # The loop may run zero times; then its variable has no value.
        if self.scope.assigned is not None and target.id not in before:
            self.scope.assigned.discard(target.id)
        return [Count(counter, start, stop, step, [first, *body])]

    def _target(self, node: ast.For) -> ast.Name:
        if not isinstance(node.target, ast.Name):
            raise self.problem(node.target, "a loop over several names", "use one name")
        return node.target

    def _for_items(self, node: ast.For, sequence: tuple[str, ValueKind, int]) -> list[Statement]:
        name, kind, length = sequence
        counter = self.scope.temporary()
        item = Item(kind, name, length, Variable(ValueKind.INT, counter))
        start, stop = Constant(ValueKind.INT, 0), Constant(ValueKind.INT, length)
        return self._counted(node, counter, start, stop, 1, item)

    def _for_events(self, node: ast.For) -> list[Statement]:
        """A loop over the events of a batch: the variable stands for one event."""
        event = self.reference(node.iter)
        target = self._target(node)
        if not isinstance(event, EventItself) or not event.batch:
            raise self.problem(node.iter, "a loop over one event", "use together=True")
        if target.id in self.scope.kinds or target.id in self.scope.references:
            raise self.problem(target, f"another value for {target.id}", "use another variable")
        counter = self.scope.temporary()
        place = Variable(ValueKind.INT, counter)
        self.scope.references[target.id] = EventItself(False, place)
        body = self._loop(node.body)
        del self.scope.references[target.id]
        start, stop = (Variable(ValueKind.INT, name) for name in ("e_begin", "e_end"))
        return [Count(counter, start, stop, 1, body)]

    # --- helpers ---

    def helper(
        self, node: ast.Call, function: FunctionType, bound: tuple[Reference, ...]
    ) -> Expression:
        arguments = [*bound, *(self._argument(argument) for argument in node.args)]
        named = {str(word.arg): self._argument(word.value) for word in node.keywords}
        try:
            call = inspect.signature(function).bind(*arguments, **named)
        except TypeError as error:
            raise self.problem(node, f"this call of {function.__name__}: {error}") from None
        call.apply_defaults()
        given = {name: self._plain(node, value) for name, value in call.arguments.items()}
        made = self._made(node, function, given)
        passed = [self._passed_on(slot, given) for slot in made.parameters]
        return Call(made.kind, made.name, (STATE, WORDS, ROW, *passed))

    def _passed_on(self, slot: Slot, given: Mapping[str, Any]) -> Expression:
        """An argument of a helper: a value of the call, or an attribute that the helper reads."""
        name = slot.name.removeprefix("v_")
        if slot.name.startswith("v_") and name in given:
            value: Expression = given[name]
            return self.as_mixed(value) if slot.kind is ValueKind.MIXED else value
        return self._passed(Variable(slot.kind, slot.name))

    def _argument(self, node: ast.expr) -> Any:
        reference = self.reference(node) if isinstance(node, ast.Name | ast.Attribute) else None
        if reference is not None and not isinstance(reference, Known | BoundMethod):
            return reference
        return self.value(node)

    def _plain(self, node: ast.Call, value: Any) -> Any:
        """An argument; default values are constants."""
        if isinstance(value, EventItself):
            raise self.problem(node, "the event as an argument", "pass the data that are needed")
        if isinstance(value, Reference | Expression):
            return value
        constant = self.constant_of(value)
        if constant is None:
            raise self.problem(node, f"the argument {value!r}", "pass numbers, bools or texts")
        return constant

    def _made(self, node: ast.Call, function: FunctionType, given: Mapping[str, Any]) -> Helper:
        """The helper for arguments of these kinds."""
        method = self.method
        key = (
            function,
            tuple(
                (name, value if isinstance(value, Reference) else value.kind)
                for name, value in given.items()
            ),
        )
        if function in method.calling:
            raise self.problem(node, "a function that calls itself", "write a loop")
        if key in method.helpers:
            return method.helpers[key]
        method.calling.append(function)
        references = {n: v for n, v in given.items() if isinstance(v, Reference)}
        kinds = {n: v.kind for n, v in given.items() if not isinstance(v, Reference)}
        origin = Origin.of(function)
        scope = LocalNames(origin, references, dict(kinds), assigned=set(kinds), helper=True)
        body = Statements(method, scope).function()
        method.calling.remove(function)
        slots = [Slot(f"v_{name}", scope.kinds[name]) for name in kinds]
        slots += [Slot(name, each.kind) for name, each in sorted(scope.reads.items())]
        name = f"h{len(method.helpers)}_{function.__name__}"
        made = Helper(name, tuple(slots), scope.result or ValueKind.INT, body)
        method.helpers[key] = made
        return made


def _both(first: set[str] | None, second: set[str] | None) -> set[str] | None:
    """Variables that have a value on both paths; None is a path that is not taken."""
    if first is None or second is None:
        return second if first is None else first
    return first & second


def _loaded(target: ast.expr) -> ast.expr:
    """The expression that reads what an assignment writes."""
    text = ast.unparse(target)
    read = ast.parse(text, mode="eval").body
    for node in ast.walk(read):
        ast.copy_location(node, target)
    return read
