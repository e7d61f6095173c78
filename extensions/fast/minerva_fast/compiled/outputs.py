"""Results of a compiled method: its string, newborns and emitted events."""

from __future__ import annotations

import ast
from typing import Any, cast

from minerva_bus.grammar.symbols import AgentKind, EventType
from minerva_fast.compiled.declared_values import DeclaredValues
from minerva_fast.compiled.expressions import is_empty
from minerva_fast.compiled.form import (
    Append,
    Assign,
    BinaryOperation,
    Constant,
    Emission,
    Expression,
    Finish,
    If,
    Jump,
    Newborn,
    Return,
    Slot,
    Statement,
    ValueKind,
    Variable,
)
from minerva_fast.compiled.names import (
    AgentItself,
    Known,
    LocalNames,
    Method,
    Moment,
    joined,
)
from minerva_fast.compiled.refused import EXPRESSIONS


class Outputs(DeclaredValues):
    """Checks what a method returns and emits."""

    def __init__(self, method: Method, scope: LocalNames) -> None:
        super().__init__(method, scope)
        self._repeated: set[int] = set()
        """Outputs of newborns in loops."""

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


def _summands(node: ast.expr) -> list[ast.expr]:
    """The parts of a sum, from left to right."""
    if isinstance(node, ast.BinOp) and isinstance(node.op, ast.Add):
        return [*_summands(node.left), *_summands(node.right)]
    return [node]
