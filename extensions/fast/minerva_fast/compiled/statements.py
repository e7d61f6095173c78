"""Statements of a compiled method: assignments, loops, branches, results, and calls of user code.

A value of a field of a newborn or an emitted event is checked against its declared type. A function
or method of user code that is called becomes a helper.
"""

from __future__ import annotations

import ast
import inspect
from collections.abc import Callable, Mapping, Sequence
from types import FunctionType
from typing import Any, Final, TypeAlias, cast

from minerva_bus.grammar.fields import Field, Fields
from minerva_bus.grammar.types import Type
from minerva_bus.grammar.vocabulary import AgentKind, EventType
from minerva_fast.compiled.expressions import Column, Expressions, is_empty
from minerva_fast.compiled.form import (
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
from minerva_fast.compiled.names import (
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
from minerva_fast.compiled.origin import EXPRESSIONS, STATEMENTS, Origin

MAX_ITEMS: Final = 1_000
"""Maximum length of a local list."""
_VARIABLE: Final = inspect.CO_VARARGS | inspect.CO_VARKEYWORDS
_ZERO = Constant(ValueKind.INT, 0)
Taken: TypeAlias = tuple[ast.expr, Expression]
"""A name of a loop, and the value that it takes in each turn."""


class Statements(Expressions):
    """Checks the statements of one function."""

    def __init__(self, method: Method, scope: LocalNames) -> None:
        super().__init__(method, scope)
        self._repeated: set[int] = set()
        """Outputs of newborns in loops."""
        self._breaks: list[set[str] | None] = []
        """Of each loop around a statement, the variables that have a value at its breaks."""

    # --- values of declared types ---

    def _held(self, value: Expression) -> tuple[Variable, Statement]:
        """A value in a variable of the generated function."""
        name = self.scope.temporary()
        return Variable(value.kind, name), Assign(name, value)

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
        given = dict(zip(fields.names, positional, strict=False))
        for name in given.keys() & named.keys():
            raise self.problem(node, f"two values of {name} for {owner}", "leave out one of them")
        given |= named
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

    # --- assignments ---

    def _assign(self, node: ast.Assign) -> list[Statement]:
        if len(node.targets) == 1 and isinstance(node.targets[0], ast.Name):
            name = node.targets[0]
            if isinstance(node.value, ast.List | ast.BinOp) and self._is_list(node.value):
                return self._new_list(name, node.value)
            if self._is_litter(node.value):
                return self._collect(name, node.value)
        if len(node.targets) == 1 and isinstance(node.targets[0], ast.Tuple | ast.List):
            return self._unpack(node, node.targets[0])
        value = self.value(node.value)
        if len(node.targets) == 1:
            return self.store(node.targets[0], value)
        held, statement = self._held(value)
        return [statement, *(s for target in node.targets for s in self.store(target, held))]

    def _unpack(self, node: ast.Assign, target: ast.Tuple | ast.List) -> list[Statement]:
        targets = target.elts
        if isinstance(node.value, ast.Subscript):
            columns = self.columns(node.value.value, target)
            if columns is not None:
                return self._unpack_item(node.value, columns)
        if not isinstance(node.value, ast.Tuple) or len(node.value.elts) != len(targets):
            raise self.problem(
                node, "an assignment to several names", "write as many values: a, b = b, a"
            )
        held = [self._held(self.value(each)) for each in node.value.elts]
        made = [statement for _, statement in held]
        for each, (value, _) in zip(targets, held, strict=True):
            made += self.store(each, value)
        return made

    def _unpack_item(self, item: ast.Subscript, columns: Sequence[Column]) -> list[Statement]:
        """Assign the values of one tuple of a constant tuple of tuples."""
        index, statement = self._held(self.index(item, columns[0][3]))
        made = [statement]
        for target, sequence, kind, length in columns:
            made += self.store(target, Item(kind, sequence, length, index))
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

    # --- calls of user code ---

    def helper(
        self, node: ast.Call, function: FunctionType, bound: tuple[Reference, ...]
    ) -> Expression:
        if function.__code__.co_flags & _VARIABLE:
            what = f"{function.__name__}, a function with * or **, as decorators make"
            raise self.problem(node, what, "call a function with a parameter for each argument")
        arguments = [*bound, *(self._argument(argument) for argument in node.args)]
        named = {str(word.arg): self._argument(word.value) for word in node.keywords}
        try:
            call = inspect.signature(function).bind(*arguments, **named)
        except TypeError as error:
            raise self.problem(node, f"this call of {function.__name__}: {error}") from None
        # Python evaluates arguments in the order in which they are written, and draws are in it.
        order = [*list(call.arguments)[: len(arguments)], *named]
        call.apply_defaults()
        order += [name for name in call.arguments if name not in order]
        given = {name: self._plain(node, call.arguments[name]) for name in order}
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

    # --- loops ---

    def _jump(self, node: ast.AST, jump: Jump) -> list[Statement]:
        if jump is Jump.BREAK:
            left = self._breaks[-1]
            self._breaks[-1] = both(left, self.scope.assigned)
        self.scope.assigned = None
        return [jump]

    def _body(self, body: Sequence[ast.stmt]) -> tuple[list[Statement], set[str] | None]:
        """The body of a loop, and the variables that have a value at its breaks."""
        self._breaks.append(None)
        self.scope.loops += 1
        checked = self.block(body)
        self.scope.loops -= 1
        return checked, self._breaks.pop()

    def _else(
        self, node: ast.While | ast.For, ended: set[str] | None, left: set[str] | None
    ) -> list[Statement]:
        """The `else` of a loop, with the variables that have a value at its end and its breaks."""
        self.scope.assigned = ended
        checked = self.block(node.orelse)
        self.scope.assigned = both(self.scope.assigned, left)
        return checked

    def _while(self, node: ast.While) -> list[Statement]:
        endless = isinstance(node.test, ast.Constant) and bool(node.test.value)
        test, before = self.truth(node.test), set(self.scope.assigned or ())
        body, left = self._body(node.body)
        return [While(test, body, self._else(node, None if endless else before, left))]

    def _for(self, node: ast.For) -> list[Statement]:
        if self._called(node.iter) is range:
            return self._for_range(node, node.iter)
        if isinstance(self.reference(node.iter), EventItself):
            return self._for_events(node)
        counter = self.scope.temporary()
        taken, length = self._taken(node.target, node.iter, Variable(ValueKind.INT, counter))
        return self._counted(node, counter, _ZERO, Constant(ValueKind.INT, length), 1, taken)

    def _called(self, node: ast.expr) -> object:
        """The known function that an expression calls."""
        function = self.reference(node.func) if isinstance(node, ast.Call) else None
        return function.value if isinstance(function, Known) else None

    # --- loops over sequences ---

    def _taken(self, target: ast.expr, node: ast.expr, place: Variable) -> tuple[list[Taken], int]:
        """The names of a loop with their values, and the number of turns."""
        if isinstance(node, ast.Call) and self._called(node) is enumerate:
            return self._numbered(target, node, place)
        if isinstance(node, ast.Call) and self._called(node) is zip:
            return self._zipped(target, node, place)
        columns = self.columns(node, target)
        if columns is None:
            raise self._no_loop(node)
        taken: list[Taken] = [
            (name, Item(kind, sequence, length, place)) for name, sequence, kind, length in columns
        ]
        return taken, columns[0][3]

    def _numbered(
        self, target: ast.expr, call: ast.Call, place: Variable
    ) -> tuple[list[Taken], int]:
        named = [word.value for word in call.keywords if word.arg == "start"]
        given = [*call.args, *named]
        first = self.value(given[1]) if len(given) == 2 else _ZERO
        known = isinstance(first, Constant) and first.kind is ValueKind.INT
        if not known or len(given) not in (1, 2) or len(named) != len(call.keywords):
            raise self.problem(
                call, "these arguments of enumerate", "write enumerate(TABLE, 1), with a constant"
            )
        number, item = self._names(target, 2)
        taken, length = self._taken(item, call.args[0], place)
        return [(number, self.operation(call, ast.Add(), place, first)), *taken], length

    def _zipped(self, target: ast.expr, call: ast.Call, place: Variable) -> tuple[list[Taken], int]:
        if call.keywords or not call.args:
            raise self.problem(call, "these arguments of zip", "write zip(FIRST, SECOND)")
        names = self._names(target, len(call.args))
        parts = [
            self._taken(name, part, place) for name, part in zip(names, call.args, strict=True)
        ]
        return [each for taken, _ in parts for each in taken], min(length for _, length in parts)

    def _names(self, target: ast.expr, count: int) -> list[ast.expr]:
        if not isinstance(target, ast.Tuple | ast.List) or len(target.elts) != count:
            raise self.problem(
                target, f"a loop over {count} values in a turn", f"use {count} names: for a, b in"
            )
        return target.elts

    def _no_loop(self, node: ast.expr) -> Exception:
        if isinstance(node, ast.Call):
            self.value(node)
        return self.problem(
            node,
            "a loop over this",
            "loop over range(...), a constant tuple, a local list or a batch of events",
        )

    # --- loops that count ---

    def _for_range(self, node: ast.For, call: ast.expr) -> list[Statement]:
        assert isinstance(call, ast.Call)
        if call.keywords or not 1 <= len(call.args) <= 3:
            raise self.problem(call, "these arguments of range", "write range(start, stop, step)")
        values = [self.value(argument) for argument in call.args]
        if any(value.kind is not ValueKind.INT for value in values):
            raise self.problem(call, "a range of numbers that are not ints", "write int(...)")
        step = values[2] if len(values) == 3 else Constant(ValueKind.INT, 1)
        if not isinstance(step, Constant) or step.value == 0:
            raise self.problem(call, "a step that is not a constant", "write a number, such as 2")
        start, stop = (_ZERO, values[0]) if len(values) == 1 else values[:2]
        counter = self.scope.temporary()
        taken: list[Taken] = [(node.target, Variable(ValueKind.INT, counter))]
        return self._counted(node, counter, start, stop, int(step.value), taken)

    def _counted(
        self,
        node: ast.For,
        counter: str,
        start: Expression,
        stop: Expression,
        step: int,
        taken: Sequence[Taken],
    ) -> list[Statement]:
        # The loop may run zero times; then its names have no value.
        before = set(self.scope.assigned or ())
        first = [self.assign(self._name_of(target), value) for target, value in taken]
        body, left = self._body(node.body)
        return [Count(counter, start, stop, step, [*first, *body], self._else(node, before, left))]

    def _name_of(self, target: ast.expr) -> ast.Name:
        if not isinstance(target, ast.Name):
            raise self.problem(target, "a loop over this", "use a name for each value")
        return target

    def _for_events(self, node: ast.For) -> list[Statement]:
        """A loop over the events of a batch: the variable stands for one event."""
        event = self.reference(node.iter)
        target = self._name_of(node.target)
        if not isinstance(event, EventItself) or not event.batch:
            raise self.problem(node.iter, "a loop over one event", "use together=True")
        if target.id in self.scope.kinds or target.id in self.scope.references:
            raise self.problem(target, f"another value for {target.id}", "use another variable")
        before = set(self.scope.assigned or ())
        counter = self.scope.temporary()
        place = Variable(ValueKind.INT, counter)
        self.scope.references[target.id] = EventItself(False, place)
        body, left = self._body(node.body)
        del self.scope.references[target.id]
        start, stop = (Variable(ValueKind.INT, name) for name in ("e_begin", "e_end"))
        return [Count(counter, start, stop, 1, body, self._else(node, before, left))]

    # --- blocks and branches ---

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
        while True:  # It ends, because a kind only changes to MIXED, and then stays.
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
        self.scope.assigned = both(after_then, self.scope.assigned)
        return [If(test, then, otherwise)]


def _summands(node: ast.expr) -> list[ast.expr]:
    """The parts of a sum, from left to right."""
    if isinstance(node, ast.BinOp) and isinstance(node.op, ast.Add):
        return [*_summands(node.left), *_summands(node.right)]
    return [node]


def _loaded(target: ast.expr) -> ast.expr:
    """The expression that reads what an assignment writes."""
    text = ast.unparse(target)
    read = ast.parse(text, mode="eval").body
    for node in ast.walk(read):
        ast.copy_location(node, target)
    return read


def both(first: set[str] | None, second: set[str] | None) -> set[str] | None:
    """Variables that have a value on both paths; None is a path that is not taken."""
    if first is None or second is None:
        return second if first is None else first
    return first & second
