"""The table [placement] of a world file: which hosts may have which agents."""

from __future__ import annotations

from typing import Any, cast

from minerva_bus.errors import nearest
from minerva_bus.frame.constraints import PlacementRules, Rule
from minerva_bus.grammar.vocabulary import Vocabulary
from minerva_bus.launch.table import Table
from minerva_bus.settings.kinds import TEXT, TEXTS
from minerva_bus.settings.tables import PlacementSettings


def read_placement(table: Table, vocabulary: Vocabulary) -> PlacementRules:
    """The placement rules of a world file. Raises WorldFileError."""
    limit = table.read(PlacementSettings).agents_per_host
    rules: dict[str, Rule] = {}
    for kind, hosts in table.rest().items():
        if kind not in vocabulary.kinds:
            known = list(vocabulary.kinds)
            table.wrong(
                kind,
                f"is not an agent kind of this world{nearest(kind, [*known, 'agents_per_host'])};"
                f" it has {', '.join(known) or 'none'}",
            )
        rules[kind] = _rule(table, kind, hosts)
    return PlacementRules(rules, limit)


def _rule(table: Table, kind: str, hosts: Any) -> Rule:
    if isinstance(hosts, dict):
        inner = table.table(kind)
        rule = Rule(inner.get("only", TEXTS, ()), inner.get("near", TEXT, ""))
        inner.done()
    else:
        names = cast("list[Any]", hosts if isinstance(hosts, list) else [hosts])
        if not all(isinstance(name, str) for name in names):
            table.wrong(kind, 'must be a list of hosts, or { only = ["HOST"], near = "MEMBER" }')
        rule = Rule(tuple(names))
    if rule == Rule():
        table.wrong(kind, 'allows nothing; name hosts, or near = "MEMBER"')
    return rule
