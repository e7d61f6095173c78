"""Which matrices a rule changes: those of which it does more than read items are taken as changed.

A rule gets the memory of the string for a matrix that it only reads, so what this check does not
recognize counts as a change. If it takes a change for reading, the compiler refuses the rule,
because such an array is read-only there.
"""

from __future__ import annotations

import ast
from collections.abc import Collection
from types import FunctionType

from minerva_bus.world.accelerator import NotCompilable
from minerva_fast.compiled.origin import Origin
from minerva_fast.space.callable import called


def only_read(function: FunctionType, names: Collection[str]) -> frozenset[str]:
    """Those of these parameters of which a function only reads items (`grass[cell]`) or `len`."""
    try:
        origin = Origin.of(function)
    except NotCompilable:  # such as a rule without source
        return frozenset()
    reading = {id(node) for each in ast.walk(origin.tree) for node in _read(origin, each)}
    used = [node for node in ast.walk(origin.tree) if isinstance(node, ast.Name)]
    changed = {node.id for node in used if id(node) not in reading}
    return frozenset(names) - changed


def _read(origin: Origin, node: ast.AST) -> list[ast.AST]:
    """The parts of a node that are only read, if they are names."""
    if isinstance(node, ast.Subscript) and isinstance(node.ctx, ast.Load):
        return [node.value]
    if isinstance(node, ast.Call) and called(origin, node.func) is len:
        return [*node.args]
    return []
