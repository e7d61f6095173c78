"""Methods of agents: what they return, the statements that only they have, and their kernels.

A value of a field of a newborn or an emitted event is checked against its declared type.

The printed module has a function for a row, and the kernel that runs it for many rows. A row is
atomic: it reads its attributes into variables and writes them back at its end, and after a fault
its draws and outputs are undone.

    a_x  attribute    v_x  local variable   d_x  data of the event     o0_x  output 0
    c_x  its column   l_0  local list       g_x  given by the frame    t_0   temporary
"""

from __future__ import annotations

import ast
import inspect
from collections.abc import Callable, Iterator, Mapping, Sequence
from typing import Any, Final, cast

from minerva_bus.grammar.fields import Field, Fields
from minerva_bus.grammar.types import Type
from minerva_bus.grammar.vocabulary import AgentKind, EventType
from minerva_bus.user_code import handler_name, variables_of
from minerva_bus.world.class_declaration import NotCompilable, takes_batch
from minerva_fast.draws import PLACE
from minerva_fast.expressions import is_empty
from minerva_fast.origin import REAL_EVERYWHERE, Origin
from minerva_fast.statements import (
    FIRST_TURN,
    LAST_TURN,
    Results,
    Statements,
    is_counted,
    printed_functions,
)
from minerva_fast.values import (
    DECLARED,
    STEP,
    Emission,
    FunctionScope,
    Given,
    Known,
    Method,
    Newborn,
    Output,
    Slot,
    Value,
    ValueKind,
    constant,
    indented,
    variable,
)

FAILED: Final = 2
FULL: Final = 3
"""Outcomes of a row. FULL: an output has no free row; it is enlarged and the row repeated."""
GONE: Final = 1
STAYS: Final = "return 0"
"""Printed after the lines that write the attributes."""


# --- values of declared types ---


def declared(check: Statements, node: ast.AST, name: str, type_: Type, value: Value) -> Value:
    """A value converted to a declared type, as where a string is made."""
    kind = DECLARED.get(type_.kind)
    if kind is ValueKind.REAL and value.kind in (ValueKind.INT, ValueKind.NUMBER):
        return check.expressions.as_real(value)
    if kind is not value.kind:
        whole = kind is ValueKind.INT and value.kind in (ValueKind.REAL, ValueKind.NUMBER)
        instead = "write int(...)" if whole else "convert it"
        instead = "compare: x != 0" if kind is ValueKind.BOOL else instead
        what = f"{name} is declared as {type_}, and this is {value.kind.value}"
        raise check.problem(node, what, instead)
    if type_.words and value.constant is not None:
        text = list(check.method.texts)[int(value.constant)]
        if text not in type_.words:
            instead = f"use one of {', '.join(type_.words)}"
            raise check.problem(node, f"{name} must not be {text!r}", instead)
    return value


def fitting(method: Method, type_: Type, name: str) -> str | None:
    """A test whether a variable fits its declared type; None if every value does."""
    if type_.words:
        return " or ".join([f"{name} == {method.code(word)}" for word in type_.words])
    if type_.kind == "real" or type_.range is not None:
        limits = (type_.range.least, type_.range.most) if type_.range else (-_INFINITY, _INFINITY)
        ends = ", ".join([constant(ValueKind.REAL, end).text for end in limits])
        number = name if type_.kind == "real" else f"exact({name})"
        return f"within({number}, {ends})"
    return None


_INFINITY: Final = float("inf")


def _all_values(
    check: Statements, node: ast.Call, owner: str, fields: Fields, named: Mapping[str, ast.expr]
) -> tuple[list[str], list[Value]]:
    """The values of all fields in order, held in variables and checked where the call has them."""
    positional = node.args if owner[:1] == "e" else node.args[1:]
    if any(isinstance(argument, ast.Starred) for argument in node.args) or "None" in named:
        raise check.problem(node, "arguments with *", "write each argument")
    if len(positional) > len(fields.names):
        raise check.problem(node, f"{owner} takes {len(fields.names)} values")
    given = dict(zip(fields.names, positional, strict=False))
    for name in given.keys() & named.keys():
        raise check.problem(node, f"two values of {name} for {owner}", "leave out one of them")
    given |= named
    types = {each.name: each.type for each in fields.all}
    made, values = list[str](), dict[str, Value]()
    for name, argument in given.items():  # in the order in which Python evaluates them
        if name not in types:
            listed = ", ".join(fields.names) or "none"
            raise check.problem(node, f"{owner} has no {name}", f"it has {listed}")
        value = declared(check, argument, name, types[name], check.value(argument))
        values[name], lines = check.held(value)
        test = fitting(check.method, types[name], values[name].text)
        made += [*lines, *([] if test is None else check.fault_unless(test))]
    return made, [
        values[each.name] if each.name in values else _default(check, node, owner, each)
        for each in fields.all
    ]


def _default(check: Statements, node: ast.AST, owner: str, field: Field) -> Value:
    known = None if field.default is None else check.expressions.constant_of(field.default)
    if known is None:
        raise check.problem(node, f"{owner} needs a value for {field.name} ({field.type})")
    # Defaults have the types of their fields, but an int may be the default of a real.
    real = field.type.kind == "real" and known.kind is ValueKind.INT
    return check.expressions.as_real(known) if real else known


def _summands(node: ast.AST, value: ast.expr | None) -> list[ast.expr]:
    """The parts of a sum, from left to right; `return` alone is None."""
    if value is None:
        return [ast.copy_location(ast.Constant(None), node)]
    if isinstance(value, ast.BinOp) and isinstance(value.op, ast.Add):
        return [*_summands(node, value.left), *_summands(node, value.right)]
    return [value]


def _is_epsilon(check: Statements, node: ast.expr) -> bool:
    named = isinstance(node, ast.Name | ast.Attribute)
    reference = check.expressions.reference(node) if named else None
    return isinstance(reference, Known) and is_empty(reference.value)


def _is_of_agent(check: Statements, node: ast.expr, name: str) -> bool:
    """Whether an expression is `self.name`."""
    return (
        isinstance(node, ast.Attribute)
        and node.attr == name
        and check.expressions.reference(node.value) is Given.AGENT
    )


def _appended(output: Output, index: int, values: Sequence[Value]) -> list[str]:
    """The lines that append a row to an output."""
    count, texts = f"counts[{index}]", ["k", *[value.text for value in values]]
    return [
        f"if {count} == len(o{index}_place):",
        *indented([f"return {FULL}"]),
        *(
            f"o{index}_{name}[{count}] = {text}"
            for (name, _), text in zip(cells(output), texts, strict=True)
        ),
        f"{count} += 1",
    ]


def cells(output: Output) -> list[tuple[str, ValueKind]]:
    """The columns of an output: the place of the row in the round, and what was appended."""
    made = [("place", ValueKind.INT)]
    if isinstance(output, Newborn):
        made.append(("births", ValueKind.INT))
    made += [(f"v_{slot.name}", slot.kind) for slot in output.slots]
    if isinstance(output, Emission) and output.receiver:
        made.append(("receiver", ValueKind.TEXT))
    return made


def _choice(results: Any, check: Statements, node: ast.Return, value: ast.IfExp) -> list[str]:
    """`return a if test else b` is a branch with two results."""
    yes, no = (ast.copy_location(ast.Return(each), node) for each in (value.body, value.orelse))
    return check.branch(
        value.test, lambda: results.returned(check, yes), lambda: results.returned(check, no)
    )


class MethodResults(Results):
    """A method of an agent: changes of its attributes, its string with newborns, and events."""

    def end(self, check: Statements) -> list[str]:
        """The agent stays."""
        return [STAYS]

    def returned(self, check: Statements, node: ast.Return) -> list[str]:
        """Whether the agent stays, and its newborns."""
        if isinstance(node.value, ast.IfExp):
            return _choice(self, check, node, node.value)
        made, stays = list[str](), False
        for index, part in enumerate(_summands(node, node.value)):
            none = isinstance(part, ast.Constant) and part.value is None
            if _is_of_agent(check, part, "string") or (none and not index):
                if index:
                    instead = "return self.string + self.child(...)"
                    raise check.problem(part, "self.string after newborns", instead)
                stays = True
            elif isinstance(part, ast.Call) and _is_of_agent(check, part.func, "child"):
                made += self._child(check, part)
            elif not _is_epsilon(check, part):
                instead = "return None, EMPTY, self.string, or self.string + self.child(...)"
                raise check.problem(part, "this result", instead)
        return [*made, STAYS if stays else f"return {GONE}"]

    def store(self, check: Statements, target: ast.Attribute, value: Value) -> list[str]:
        """An attribute of the agent."""
        name, method = target.attr, check.method
        if check.expressions.reference(target.value) is not Given.AGENT:
            instead = "change attributes of self only"
            raise check.problem(target, "an assignment to this", instead)
        if name not in method.types:
            if name.startswith("_"):
                raise check.problem(target, "a temporary attribute", "use a local variable")
            check.value(target)
            raise check.problem(target, f"an assignment to self.{name}", "declare the attribute")
        method.writes[name] = None
        check.expressions.attribute(name)
        if method.types[name].kind == "real" and value.kind in (ValueKind.INT, ValueKind.NUMBER):
            # Python keeps the int until the end of the frame.
            what = f"{value.kind.value} in self.{name}, a real"
            raise check.problem(target, what, REAL_EVERYWHERE)
        value = declared(check, target, name, method.types[name], value)
        return [f"a_{name} = {value.text}"]

    def emit(self, check: Statements, node: ast.Call) -> list[str] | None:
        """An emitted event."""
        match node.func:
            case ast.Attribute(attr="emit", value=owner):
                if check.expressions.reference(owner) is not Given.MOMENT:
                    return None
            case _:
                return None
        event = node.args[0] if len(node.args) == 1 and not node.keywords else None
        known = check.expressions.reference(event.func) if isinstance(event, ast.Call) else None
        if not (
            isinstance(event, ast.Call)
            and isinstance(known, Known)
            and isinstance(known.value, EventType)
        ):
            instead = "call an event type: moment.emit(eCall(loud=1.0))"
            raise check.problem(node, "this argument of emit", instead)
        return self._emitted(check, event, known.value)

    def _emitted(self, check: Statements, node: ast.Call, event_type: EventType) -> list[str]:
        named = {str(keyword.arg): keyword.value for keyword in node.keywords}
        receivers, condition = named.pop("receivers", None), named.pop("condition", None)
        named.pop("sender", None)  # the agent is the sender, whatever the event has
        constant_text = isinstance(condition, ast.Constant) and isinstance(condition.value, str)
        if condition is not None and not constant_text:
            raise check.problem(condition, "a computed condition", "write a constant text")
        name, fields, method = event_type.name, event_type.fields, check.method
        made, values = _all_values(check, node, name, fields, named)
        slots = [Slot(n, v.kind) for n, v in zip(fields.names, values, strict=True)]
        if receivers is not None:
            receiver, lines = check.held(self._receiver(check, receivers))
            empty = check.expressions.text("").text
            made += [*lines, *check.fault_unless(f"{receiver.text} != {empty}")]
            values.append(receiver)
        shown = "" if condition is None else str(cast("ast.Constant", condition).value)
        output = Emission(name, tuple(slots), receivers is not None, shown)
        for other in method.outputs:
            if isinstance(other, Emission) and other.event_type == name and other != output:
                what = f"{name} emitted with and without a receiver, or with two conditions"
                raise check.problem(node, what, "emit events of one type in one form")
        if output not in method.outputs:
            method.outputs.append(output)
        return [*made, *_appended(output, method.outputs.index(output), values)]

    def _receiver(self, check: Statements, node: ast.expr) -> Value:
        if not isinstance(node, ast.List | ast.Tuple) or len(node.elts) != 1:
            instead = "name one agent, and emit an event for each: receivers=[self.mother]"
            raise check.problem(node, "computed receivers, or several", instead)
        value = check.value(node.elts[0])
        if value.kind is not ValueKind.TEXT:
            raise check.problem(node, f"{value.kind.value} as a receiver", "use an id")
        return value

    # --- newborns ---

    def _child(self, check: Statements, node: ast.Call) -> list[str]:
        """A newborn: its values, and the parent's number of births."""
        method = check.method
        cls = self._child_class(check, node)
        kind = method.cls.kind if cls is None else cls.kind
        if "births" not in method.types or method.types["births"].kind != "int":
            instead = "declare `births: int = 0` in the class"
            raise check.problem(node, "child without births", instead)
        named = {str(keyword.arg): keyword.value for keyword in node.keywords}
        named.pop("kind", None)
        made, values = _all_values(check, node, kind.name, kind.fields, named)
        method.read("births")
        method.writes["births"] = None
        slots = [Slot(n, v.kind) for n, v in zip(kind.fields.names, values, strict=True)]
        method.outputs.append(Newborn(cls, tuple(slots)))
        made += ["a_births = add(a_births, 1)"]
        births = variable(ValueKind.INT, "a_births")
        return [*made, *_appended(method.outputs[-1], len(method.outputs) - 1, [births, *values])]

    def _child_class(self, check: Statements, node: ast.Call) -> Any:
        """The class of a newborn; None: that of its parent."""
        named = [keyword.value for keyword in node.keywords if keyword.arg == "kind"]
        given = [*node.args[:1], *named]
        if len(node.args) > 1 or len(given) > 1:
            instead = "write child(ValueKind, x=...)"
            raise check.problem(node, "these arguments of child", instead)
        reference = check.expressions.reference(given[0]) if given else None
        cls = reference.value if isinstance(reference, Known) else None
        if not given or cls is check.method.cls:
            return None
        if not isinstance(getattr(cls, "kind", None), AgentKind):
            raise check.problem(given[0], "this kind of child", "name an agent class")
        return cls


# --- kernels ---


def printed(method: Method, body: Sequence[str]) -> str:
    """The text of the module of a method."""
    lines = [*_row(method, body)]
    types, names = zip(*_arguments(method), strict=True)
    row = ["@inlined", f"def row({', '.join(['i', 'k', *names[2:]])}):", *indented(lines)]
    kernel = [
        f"@kernel(int64({', '.join(['int64', *types])}))",
        f"def run(start, {', '.join(names)}):",
        *indented([*_kernel(method, names, counted=is_counted(method, lines))]),
    ]
    return "\n".join([printed_functions(method, row), "", "", *kernel, ""])


def _arguments(method: Method) -> Iterator[tuple[str, str]]:
    """The types and names of the parameters of a kernel, in order, after `start`."""
    yield "read_only(int64)", "rows"
    yield "cells(uint8)", "outcomes"
    for name in ("counts", "progress", "saved"):
        yield "cells(int64)", name
    yield "cells(uint64)", "words"
    for name, kind in method.reads.items():
        form = "cells" if name in method.writes else "read_only"
        yield f"{form}({kind.machine})", f"c_{name}"
    for name, kind in method.data.items():
        yield f"read_only({kind.machine})", f"d_{name}"
    for name, kind in method.given.items():
        own = f"read_only({kind.machine})" if name in ("id", "sender") else kind.machine
        yield own, "ids" if name == "id" else f"g_{name}"
    for each in method.lists.values():
        yield f"cells({each.kind.machine})", each.text
    for index, output in enumerate(method.outputs):
        for name, kind in cells(output):
            yield f"cells({kind.machine})", f"o{index}_{name}"


def _row(method: Method, body: Sequence[str]) -> Iterator[str]:
    for name in method.reads:
        yield f"a_{name} = c_{name}[i]"
    if "id" in method.given:
        yield "g_id = ids[i]"
    stored = [*_stored(method)]
    for line in body:
        depth = line[: -len(STAYS)]
        yield from [depth + each for each in stored] if line.endswith(STAYS) else []
        yield line


def _kernel(method: Method, names: Sequence[str], *, counted: bool) -> Iterator[str]:
    """The loop over rows. It returns the place of the first row that has not run."""
    outputs = range(len(method.outputs))
    yield "for k in range(start, len(rows)):"
    yield f"{STEP}i = rows[k]"
    # What the driver undoes after a fault.
    yield f"{STEP}progress[{PLACE}] = k"
    if counted:
        yield STEP + FIRST_TURN
    if method.draws:
        yield f"{STEP}saved[{len(outputs)}] = int64(words[i])"
    for index in outputs:
        yield f"{STEP}saved[{index}] = counts[{index}]"
    yield f"{STEP}outcome = row({', '.join(['i', 'k', *names[2:]])})"
    if method.outputs or method.writes:
        yield f"{STEP}if outcome >= {FAILED}:"
        for index in outputs:
            yield f"{STEP * 2}counts[{index}] = saved[{index}]"
        if method.draws:
            yield f"{STEP * 2}words[i] = uint64(saved[{len(outputs)}])"
        yield f"{STEP * 2}if outcome == {FULL}:"
        yield f"{STEP * 3}return k"
    yield f"{STEP}outcomes[k] = outcome"
    if counted:
        yield from indented(LAST_TURN)
    yield "return len(rows)"


def _stored(method: Method) -> Iterator[str]:
    """The lines that write the attributes of an agent that stays."""
    for name in method.writes:
        test = fitting(method, method.types[name], f"a_{name}")
        yield from [f"if not ({test}):", f"{STEP}return {FAILED}"] if test else []
    for name in method.writes:
        yield f"c_{name}[i] = a_{name}"


# --- methods of a class ---


def checked_methods(cls: Any, methods: Mapping[str, Callable[..., Any]]) -> dict[str, Method]:
    """The checked methods of a class by event type. Raises NotCompilable."""
    for function in methods.values():
        if takes_batch(function):
            raise NotCompilable(
                f"{handler_name(function)} cannot be compiled: it takes all events of an agent"
                " together; leave out together=True, or write it for a population"
            )
    return {
        event_type: _checked(cls, event_type, function)
        for event_type, function in sorted(methods.items())
    }


def _event_type_of(function: Callable[..., Any], name: str) -> EventType | None:
    """The event type of a name in the module of a function, which has the types of its data."""
    scope: Mapping[str, Any] = getattr(function, "__globals__", {})
    for value in (*scope.values(), *variables_of(function).values()):
        if isinstance(value, EventType) and value.name == name:
            return value
    return None


_PARAMETERS: Final = Given.AGENT, Given.EVENT, Given.MOMENT


def _checked(cls: Any, event_type: str, function: Callable[..., Any]) -> Method:
    types: Mapping[str, Type] = {field.name: field.type for field in cls.kind.fields.all}
    for name, declared in types.items():
        if declared.kind not in DECLARED:
            raise NotCompilable(
                f"{cls.__name__} has compiled methods, so its attributes must be numbers, bools or"
                f" texts; {name} is a {declared}"
            )
    origin = Origin.of(function)
    declaration = _event_type_of(function, event_type)
    method = Method(f"{origin.name} at {event_type}", cls, types, declaration)
    names = [
        parameter.name
        for parameter in inspect.signature(origin.function).parameters.values()
        if parameter.kind in (parameter.POSITIONAL_ONLY, parameter.POSITIONAL_OR_KEYWORD)
    ]
    if len(names) != len(_PARAMETERS):
        what = "parameters other than (self, event, moment)"
        raise origin.problem(origin.tree, what, "take exactly these 3")
    scope = FunctionScope(origin, dict(zip(names, _PARAMETERS, strict=True)))
    method.text = printed(method, Statements(method, scope, MethodResults()).function())
    return method
