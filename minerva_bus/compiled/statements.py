"""Statements of a compiled method: control flow, assignments, newborns, emitted events."""

from __future__ import annotations

import ast
import inspect
from collections.abc import Callable, Mapping, Sequence
from types import FunctionType
from typing import Any, Final, cast

from minerva_bus.compiled.expressions import Expressions, is_empty
from minerva_bus.compiled.form import (
    Append,
    Assign,
    BinaryOperation,
    Call,
    Constant,
    Count,
    Emission,
    Expression,
    Finish,
    Helper,
    If,
    Item,
    Jump,
    ListSlot,
    Logic,
    Newborn,
    Return,
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
    Moment,
    Reference,
    joined,
    kind_of,
    limit_of,
)
from minerva_bus.compiled.origin import Origin
from minerva_bus.compiled.refused import EXPRESSIONS, STATEMENTS
from minerva_bus.grammar.fields import Field, Fields
from minerva_bus.grammar.symbols import AgentKind, EventType
from minerva_bus.grammar.types import Type

MAX_ITEMS: Final = 1_000
"""Maximum length of a local list."""

_PASSES: Final = 10
"""Passes over a function until the kinds of its variables are known: each may change once."""


class Statements(Expressions):
    """Checks the statements of one function."""

    def __init__(self, method: Method, scope: LocalNames) -> None:
        super().__init__(method, scope)
        self._breaks: list[set[str] | None] = []
        """Of each loop around a statement, the variables that have a value at its breaks."""
        self._repeated: set[int] = set()
        """Outputs of newborns in loops."""

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

    def _held(self, value: Expression) -> tuple[Variable, Statement]:
        """A value in a variable of the generated function."""
        name = self.scope.temporary()
        return Variable(value.kind, name), Assign(name, value)

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

    def declared(self, node: ast.AST, name: str, declared: Type, value: Expression) -> Expression:
        """A value converted to a declared type, as where a string is made."""
        kind = kind_of(declared)
        if kind is ValueKind.REAL and value.kind.number:
            return self.as_real(value)
        if kind is not value.kind:
            instead = (
                "write int(...)" if kind is ValueKind.INT and value.kind.number else "convert it"
            )
            if kind is ValueKind.BOOL:
                instead = "compare: x != 0"
            raise self.problem(
                node, f"{name} is declared as {declared}, and this is {value.kind.value}", instead
            )
        if declared.words and isinstance(value, Constant):
            texts = list(self.method.texts)
            if texts[int(value.value)] not in declared.words:
                raise self.problem(
                    node,
                    f"{name} must not be {texts[int(value.value)]!r}",
                    f"use one of {', '.join(declared.words)}",
                )
        return value

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

    # --- calls as statements ---

    def _expression(self, node: ast.Expr) -> list[Statement]:
        if isinstance(node.value, ast.Constant):  # a docstring
            return []
        if isinstance(node.value, ast.Call) and isinstance(node.value.func, ast.Attribute):
            function = node.value.func
            if isinstance(self.reference(function.value), Moment) and function.attr == "emit":
                return self._emit(node.value)
        if isinstance(node.value, ast.Call):
            return [Assign(self.scope.temporary(), self.value(node.value))]
        raise self.problem(
            node, *EXPRESSIONS.get(type(node.value), ("a value that is not used", "remove it"))
        )

    def _emit(self, node: ast.Call) -> list[Statement]:
        if self.scope.helper:
            raise self.problem(node, "emit within a helper", "emit in the method itself")
        event = node.args[0] if len(node.args) == 1 and not node.keywords else None
        known = self.reference(event.func) if isinstance(event, ast.Call) else None
        if (
            not isinstance(event, ast.Call)
            or not isinstance(known, Known)
            or not isinstance(known.value, EventType)
        ):
            raise self.problem(
                node, "this argument of emit", "call an event type: moment.emit(eCall(loud=1.0))"
            )
        return self._emitted(event, known.value)

    def _emitted(self, node: ast.Call, event_type: EventType) -> list[Statement]:
        named = {str(keyword.arg): keyword.value for keyword in node.keywords}
        receivers, condition = named.pop("receivers", None), named.pop("condition", None)
        named.pop("sender", None)  # the agent is the sender, whatever the event has
        if condition is not None and not (
            isinstance(condition, ast.Constant) and isinstance(condition.value, str)
        ):
            raise self.problem(condition, "a computed condition", "write a constant text")
        made, values = self._bound_values(node, event_type.name, event_type.fields, named)
        named_receivers = self._receivers(receivers)
        for receiver in named_receivers:
            held, statement = self._held(receiver)
            empty = BinaryOperation(ValueKind.BOOL, "==", held, self.text(""))
            made += [statement, If(empty, (Jump.FAULT,), ())]
            values.append(held)
        fields = event_type.fields
        output = Emission(
            event_type.name,
            fields.names,
            tuple(Slot(name, v.kind) for name, v in zip(fields.names, values, strict=False)),
            len(named_receivers),
            "" if condition is None else str(condition.value),
        )
        index = self.method.emission(output)
        if index is None:
            raise self.problem(
                node,
                f"{event_type.name} emitted with other numbers of receivers, or two conditions",
                "emit events of one type in one form",
            )
        return [*made, Append(index, tuple(values))]

    def _receivers(self, node: ast.expr | None) -> list[Expression]:
        if node is None:
            return []
        if not isinstance(node, ast.List | ast.Tuple):
            raise self.problem(
                node, "computed receivers", "list them: receivers=[self.mother, self.father]"
            )
        values = [self.value(each) for each in node.elts]
        for each, value in zip(node.elts, values, strict=True):
            if value.kind is not ValueKind.TEXT:
                raise self.problem(each, f"{value.kind.value} as a receiver", "use an id")
        return values

    def _bound_values(
        self, node: ast.Call, owner: str, fields: Fields, named: Mapping[str, ast.expr]
    ) -> tuple[list[Statement], list[Expression]]:
        """The values of all fields in order, held in variables, and checked against their types."""
        positional = node.args if owner[:1] == "e" else node.args[1:]
        made, values = self.given_values(node, owner, fields, positional, named)
        return made, [
            values[each.name] if each.name in values else self._default(node, owner, each)
            for each in fields.all
        ]

    def given_values(
        self,
        node: ast.Call,
        owner: str,
        fields: Fields,
        positional: Sequence[ast.expr],
        named: Mapping[str, ast.expr],
    ) -> tuple[list[Statement], dict[str, Expression]]:
        """The values of the fields that a call gives, held in variables, and checked."""
        if any(isinstance(argument, ast.Starred) for argument in node.args) or "None" in named:
            raise self.problem(node, "arguments with *", "write each argument")
        if len(positional) > len(fields.names):
            raise self.problem(node, f"{owner} takes {len(fields.names)} values")
        given = dict(zip(fields.names, positional, strict=False)) | dict(named)
        for name in given:
            if name not in fields.names:
                listed = ", ".join(fields.names) or "none"
                raise self.problem(node, f"{owner} has no {name}", f"it has {listed}")
        made, values = list[Statement](), dict[str, Expression]()
        types = {each.name: each for each in fields.all}
        for name, argument in given.items():  # in the order in which Python evaluates them
            held, statement = self._held(
                self.declared(argument, name, types[name].type, self.value(argument))
            )
            values[name] = held
            made += [statement, *self._check_fit(types[name].type, held)]
        return made, values

    def _default(self, node: ast.AST, owner: str, field: Field) -> Expression:
        constant = None if field.default is None else self.constant_of(field.default)
        if constant is None:
            raise self.problem(node, f"{owner} needs a value for {field.name} ({field.type})")
        return constant

    def _check_fit(self, declared: Type, value: Variable) -> list[Statement]:
        """A fault if a value is not of its type: not finite, out of range or another word."""
        test = self.fits(declared, value)
        return [] if test is None else [If(test, (), (Jump.FAULT,))]

    def fits(self, declared: Type, value: Variable) -> Expression | None:
        """Whether a value fits its declared type; None if every value does."""
        if declared.words:
            words = [
                BinaryOperation(ValueKind.BOOL, "==", value, self.text(word))
                for word in declared.words
            ]
            return words[0] if len(words) == 1 else Logic("or", tuple(words))
        limit = limit_of(declared)
        if declared.kind == "real":
            ends = (Constant(ValueKind.REAL, limit.least), Constant(ValueKind.REAL, limit.most))
            return Call(ValueKind.BOOL, "within", (value, *ends))
        if declared.range is not None:
            ends = (Constant(ValueKind.REAL, limit.least), Constant(ValueKind.REAL, limit.most))
            real = self.fault(ValueKind.MIXED, "exact", value)
            return Call(ValueKind.BOOL, "within", (real, *ends))
        return None

    # --- the result ---

    def _return(self, node: ast.Return) -> list[Statement]:
        if self.scope.helper:
            return self._return_value(node)
        if isinstance(node.value, ast.IfExp):
            return self._return_choice(node, node.value)
        made, stays, placed = self._result(node, node.value)
        self.scope.assigned = None
        return [*made, Finish(stays, placed)]

    def _return_choice(self, node: ast.Return, choice: ast.IfExp) -> list[Statement]:
        """`return a if test else b` is a branch with two results."""
        test, assigned = self.truth(choice.test), set(self.scope.assigned or ())
        both = list[list[Statement]]()
        for value in (choice.body, choice.orelse):
            self.scope.assigned = set(assigned)
            both.append(self._return(ast.copy_location(ast.Return(value), node)))
        return [If(test, both[0], both[1])]

    def _return_value(self, node: ast.Return) -> list[Statement]:
        if node.value is None:
            raise self.problem(node, "a function that returns nothing", "return a value")
        value = self.value(node.value)
        result = joined(self.scope.result or value.kind, value.kind)
        if result is None:
            raise self.problem(node, "results of different types", "return one type")
        self.scope.result, self.scope.assigned = result, None
        return [Return(self.as_mixed(value) if result is ValueKind.MIXED else value)]

    def _result(
        self, node: ast.Return, value: ast.expr | None
    ) -> tuple[list[Statement], bool, tuple[int, ...]]:
        """Whether the agent stays, and the outputs with the newborns that it returns."""
        if value is None or (isinstance(value, ast.Constant) and value.value is None):
            return [], True, ()
        made, stays, placed = list[Statement](), False, list[int]()
        for index, part in enumerate(_summands(value)):
            if self._is_string(part):
                if index:
                    raise self.problem(
                        part, "self.string after newborns", "return self.string + self.child(...)"
                    )
                stays = True
            elif isinstance(part, ast.Name) and part.id in self.scope.litters:
                placed += self.scope.litters[part.id]
            elif self._is_child(part):
                statements, output = self._child(cast("ast.Call", part))
                made += statements
                placed.append(output)
            elif not self._is_epsilon(part):
                raise self.problem(
                    part,
                    "this result",
                    "return None, EMPTY, self.string, or self.string + self.child(...)",
                )
        if len(set(placed)) != len(placed) or placed != sorted(placed):
            raise self.problem(value, "newborns in another order", "return them in their order")
        return made, stays, tuple(placed)

    def _is_string(self, node: ast.expr) -> bool:
        return (
            isinstance(node, ast.Attribute)
            and node.attr == "string"
            and isinstance(self.reference(node.value), AgentItself)
        )

    def _is_child(self, node: ast.expr) -> bool:
        return (
            isinstance(node, ast.Call)
            and isinstance(node.func, ast.Attribute)
            and node.func.attr == "child"
            and isinstance(self.reference(node.func.value), AgentItself)
        )

    def _is_epsilon(self, node: ast.expr) -> bool:
        reference = self.reference(node) if isinstance(node, ast.Name | ast.Attribute) else None
        return isinstance(reference, Known) and is_empty(reference.value)

    def _is_litter(self, node: ast.expr) -> bool:
        """Whether an expression is a string of newborns, for a variable that collects them."""
        first = next(iter(_summands(node)))
        collects = isinstance(first, ast.Name) and first.id in self.scope.litters
        return collects or self._is_child(first) or self._is_epsilon(first)

    def _collect(self, target: ast.Name, node: ast.expr) -> list[Statement]:
        """`litter = EMPTY`, `litter = litter + self.child(...)`, `litter += self.child(...)`."""
        name, made = target.id, list[Statement]()
        if name in self.scope.kinds or name in self.scope.references:
            raise self.problem(target, f"another value for {name}", "use another variable")
        if len(self.scope.litters | {name: []}) > 1:
            raise self.problem(target, "two variables with newborns", "use one for all")
        first, *rest = _summands(node)
        adds = isinstance(first, ast.Name) and first.id == name
        if name in self.scope.litters and not adds:
            raise self.problem(target, f"{name} set again", f"write {name} += self.child(...)")
        outputs = self.scope.litters.setdefault(name, [])
        if self.scope.loops and not adds:
            raise self.problem(
                target, "a first assignment of newborns in a loop", f"write {name} = EMPTY before"
            )
        for part in rest if adds else [first, *rest]:
            if self._is_epsilon(part):
                continue
            if not self._is_child(part):
                raise self.problem(part, "this added to newborns", "add self.child(...) only")
            statements, output = self._child(cast("ast.Call", part))
            # An output per call: in a loop, the order of two calls would be lost.
            if self.scope.loops and self._repeated:
                raise self.problem(part, "two calls of child in loops", "use one call")
            if self.scope.loops:
                self._repeated.add(output)
            outputs.append(output)
            made += statements
        return made

    def _child(self, node: ast.Call) -> tuple[list[Statement], int]:
        """A newborn: its values, the parent's number of births, and the output it goes to."""
        cls = self._child_class(node)
        kind = self.method.cls.kind if cls is None else cls.kind
        if "births" not in self.method.types or self.method.types["births"].kind != "int":
            raise self.problem(
                node, "child without births", "declare `births: int = 0` in the class"
            )
        named = {str(keyword.arg): keyword.value for keyword in node.keywords}
        named.pop("kind", None)
        made, values = self._bound_values(node, kind.name, kind.fields, named)
        self.method.reads["births"] = self.method.writes["births"] = None
        births = Variable(ValueKind.INT, "a_births")
        more = self.fault(ValueKind.INT, "add", births, Constant(ValueKind.INT, 1))
        slots = tuple(
            Slot(name, value.kind) for name, value in zip(kind.fields.names, values, strict=True)
        )
        output = self.method.newborn(Newborn(cls, slots))
        return [*made, Assign("a_births", more), Append(output, (births, *values))], output

    def _child_class(self, node: ast.Call) -> Any:
        """The class of a newborn; None: that of its parent."""
        named = [keyword.value for keyword in node.keywords if keyword.arg == "kind"]
        given = [*node.args[:1], *named]
        if len(node.args) > 1 or len(given) > 1:
            raise self.problem(node, "these arguments of child", "write child(Kind, x=...)")
        if not given:
            return None
        reference = self.reference(given[0])
        cls = reference.value if isinstance(reference, Known) else None
        if cls is self.method.cls:
            return None
        if not isinstance(getattr(cls, "kind", None), AgentKind):
            raise self.problem(given[0], "this kind of child", "name an agent class")
        return cls

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


def _summands(node: ast.expr) -> list[ast.expr]:
    """The parts of a sum, from left to right."""
    if isinstance(node, ast.BinOp) and isinstance(node.op, ast.Add):
        return [*_summands(node.left), *_summands(node.right)]
    return [node]
