"""What a world file says of watching its runs: [metrics] and [log], and of [placement]."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Final, cast

from minerva_bus.errors import MisuseError, nearest
from minerva_bus.frame.constraints import Placement, Rule
from minerva_bus.grammar.vocabulary import Vocabulary
from minerva_bus.launch.exporting import address
from minerva_bus.launch.table import Table

FORMATS: Final = ("text", "json")


@dataclass(frozen=True, slots=True)
class WatchSettings:
    """Where metrics are served, HOST:PORT ("": nowhere), and how log lines are written."""

    metrics: str = ""
    log_format: str = "text"


def read_watching(top: Table, metrics: str = "", log_format: str = "") -> WatchSettings:
    """The tables [metrics] and [log] of a world file, or what is said instead of them.

    Raises WorldFileError, and MisuseError for what is said instead.
    """
    serving, log = top.table("metrics"), top.table("log")
    own_listen, own_format = serving.text("listen"), log.choice("format", FORMATS)
    serving.done()
    log.done()
    if own_listen:
        try:
            address(own_listen)
        except MisuseError as error:
            serving.wrong("listen", f"must be HOST:PORT: {error}")
    if metrics:
        address(metrics)
    if log_format not in ("", *FORMATS):
        raise MisuseError(f"--log-format must be one of {', '.join(FORMATS)}, not {log_format!r}")
    return WatchSettings(metrics or own_listen, log_format or own_format)


def read_placement(table: Table, vocabulary: Vocabulary) -> Placement:
    """The table [placement] of a world file. Raises WorldFileError."""
    most = table.whole("agents_per_host", 0)
    rules: dict[str, Rule] = {}
    for kind, said in table.rest().items():
        if kind not in vocabulary.kinds:
            known = list(vocabulary.kinds)
            table.wrong(
                kind,
                f"is no agent kind of this world{nearest(kind, [*known, 'agents_per_host'])};"
                f" it has {', '.join(known) or 'none'}",
            )
        rules[kind] = _rule(table, kind, said)
    return Placement(rules, most)


def _rule(table: Table, kind: str, said: Any) -> Rule:
    if isinstance(said, dict):
        inner = table.table(kind)
        rule = Rule(inner.texts("only"), inner.text("near"))
        inner.done()
    else:
        hosts = cast("list[Any]", said if isinstance(said, list) else [said])
        if not all(isinstance(one, str) for one in hosts):
            table.wrong(kind, 'must be a list of hosts, or { only = ["HOST"], near = "MEMBER" }')
        rule = Rule(tuple(hosts))
    if rule == Rule():
        table.wrong(kind, 'allows nothing; name hosts, or near = "MEMBER"')
    return rule
