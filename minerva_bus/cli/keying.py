"""`minerva keys`: who belongs to a world's bus."""

from __future__ import annotations

import json as json_
from dataclasses import dataclass
from datetime import UTC, datetime
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from minerva_bus.cli.saying import say

if TYPE_CHECKING:
    from minerva_bus.security.certificates import Issued
    from minerva_bus.security.keys import Keys

app = typer.Typer(
    no_args_is_help=True,
    rich_markup_mode=None,
    help="Make and take away the certificates of those who may come in from elsewhere.",
)

Dir = Annotated[Path, typer.Option("--dir", help="The folder of the keys.")]
Hosts = Annotated[
    list[str] | None,
    typer.Option(
        "--host", help="A name or address at which it is reached; several: repeat, or commas."
    ),
]
Days = Annotated[int, typer.Option(help="How long it is valid.")]
_HERE = Path("keys")


@app.command()
def init(
    dir: Dir = _HERE,
    host: Hosts = None,
    days: Days = 3650,
) -> None:
    """Make an authority, and the coordinator's certificate."""
    keys = _keys(dir)
    made = keys.init(_split(host), days)
    say(f"{dir}: an authority until {_day(keys.now, days)}, and {_shown(made, keys.now)}")
    say(f"keep {dir / 'ca.key'} where nobody else comes: whoever has it can let anybody in")


@app.command()
def issue(
    name: Annotated[str, typer.Argument(help="The member's name, or a person's.")],
    role: Annotated[
        list[str] | None,
        typer.Option(help="agent, generator, view, operator, coordinator or router; or several."),
    ] = None,
    dir: Dir = _HERE,
    kinds: Annotated[
        list[str] | None, typer.Option(help="Only these agent kinds: AFox,ARabbit.")
    ] = None,
    events: Annotated[list[str] | None, typer.Option(help="Only these event types.")] = None,
    topics: Annotated[list[str] | None, typer.Option(help="Only these sensor topics.")] = None,
    host: Hosts = None,
    days: Days = 365,
    family: Annotated[
        bool,
        typer.Option("--family", help="For any number of members: NAME-a, NAME-b, NAME-c ..."),
    ] = False,
    renew: Annotated[
        bool,
        typer.Option("--renew", help="In place of the one there is, for the same unless you say."),
    ] = False,
) -> None:
    """Make a certificate and its key: NAME.pem and NAME.key, to be taken there with ca.pem."""
    from minerva_bus.security.certificates import Wanted

    keys = _keys(dir)
    said = (role, host, kinds, events, topics)
    before = keys.issued().get(name) if renew else None
    kept = [()] * len(said) if before is None else _purposes(before)
    fields = [
        one if words is None else _split(words) for words, one in zip(said, kept, strict=True)
    ]
    wanted = Wanted(*fields, days=days, family=family)
    say(_shown(keys.issue(name, wanted, renew=renew), keys.now))


@app.command()
def revoke(
    name: Annotated[str, typer.Argument(help="Whose certificate.")], dir: Dir = _HERE
) -> None:
    """Let a certificate count no more, in worlds that run already, too."""
    keys = _keys(dir)
    say(_shown(keys.revoke(name), keys.now))


@app.command("list")
def list_(
    dir: Dir = _HERE,
    json: Annotated[bool, typer.Option("--json", help="Print JSON.")] = False,
) -> None:
    """Show who has a certificate, what for and until when."""
    keys = _keys(dir)
    issued = keys.issued().values()
    if json:
        say(json_.dumps([_plain(one, keys.now) for one in issued]))
        return
    rows = [_TITLES, *[_Row.of(one, keys.now) for one in issued]]
    widths = [max(map(len, column)) for column in zip(*(row.cells for row in rows), strict=True)]
    for row in rows:
        cells = [cell.ljust(width) for cell, width in zip(row.cells, widths, strict=True)]
        say("  ".join(cells).rstrip())


@app.command()
def router(
    name: Annotated[str, typer.Argument(help="Whose certificate it shows: one for a router.")],
    world: Annotated[str, typer.Argument(help="The world's name.")],
    listen: Annotated[str, typer.Option(help="Where it listens.")] = "tls/0.0.0.0:7447",
    dir: Dir = _HERE,
) -> None:
    """Print a configuration for zenohd: a router that lets in whom the world itself would."""
    from minerva_bus.errors import KeysError
    from minerva_bus.runtime.endpoints import check_listening
    from minerva_bus.runtime.session import router_config
    from minerva_bus.security.access import access_control
    from minerva_bus.security.credentials import ROUTER
    from minerva_bus.wire.keys import Keys as WorldKeys

    check_listening(listen, keys=True, insecure=False)
    keys = _keys(dir)
    own = keys.credentials(name)
    if ROUTER not in own.roles:
        raise KeysError(f"the certificate of {name} is for no router; issue one with --role router")
    access = access_control(WorldKeys(world), keys.rights().values(), [], carrier=True)
    say(json_.dumps(router_config(own, listen, access), indent=2))


@dataclass(frozen=True, slots=True)
class _Row:
    """A line of the list."""

    cells: tuple[str, ...]

    @staticmethod
    def of(one: Issued, now: datetime) -> _Row:
        rights = one.rights
        confined = [*rights.kinds, *rights.events, *rights.topics, *one.hosts]
        roles = ", ".join(sorted(rights.roles))
        ends = f"{one.ends:%Y-%m-%d}"
        return _Row((rights.name, roles, one.state(now), ends, " ".join(sorted(confined))))


_TITLES = _Row(("name", "roles", "state", "until", "for"))


def _plain(one: Issued, now: datetime) -> dict[str, Any]:
    from minerva_bus.security.credentials import FAMILY

    rights = one.rights
    return {
        "name": rights.name.removesuffix(FAMILY),
        "family": rights.name.endswith(FAMILY),
        "roles": sorted(rights.roles),
        "state": one.state(now),
        "kinds": sorted(rights.kinds),
        "events": sorted(rights.events),
        "topics": sorted(rights.topics),
        "hosts": list(one.hosts),
        "from": one.begins.isoformat(),
        "until": one.ends.isoformat(),
        "serial": f"{one.serial:x}",
        "key": one.key,
    }


def _purposes(one: Issued) -> list[tuple[str, ...]]:
    """What a certificate is for: roles, hosts, kinds, events and topics."""
    rights = one.rights
    named = [tuple(sorted(some)) for some in (rights.kinds, rights.events, rights.topics)]
    return [tuple(sorted(rights.roles)), one.hosts, *named]


def _shown(one: Issued, now: datetime) -> str:
    name, roles, state, ends, confined = _Row.of(one, now).cells
    only = f", for {confined}" if confined else ""
    return f"{name}: {roles}{only}; {state}, until {ends}"


def _day(now: datetime, days: int) -> str:
    ends = min(now.timestamp() + 86400.0 * days, 253e9)
    return datetime.fromtimestamp(ends, UTC).date().isoformat()


def _keys(folder: Path) -> Keys:
    from minerva_bus.security.keys import Keys

    return Keys(folder)


def _split(words: list[str] | None) -> tuple[str, ...]:
    return tuple([one for word in words or () for one in word.split(",") if one])
