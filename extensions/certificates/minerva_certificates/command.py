"""`minerva keys`: certificates of remote members."""

from __future__ import annotations

from datetime import UTC, datetime
from json import dumps
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Final

import typer

from minerva_bus.cli import completing
from minerva_bus.cli.command_classes import Command, Group
from minerva_bus.cli.options import Json, by_comma
from minerva_bus.cli.output import print_json, print_result, print_table

if TYPE_CHECKING:
    from minerva_certificates.issuing import AuthorityFolder
    from minerva_certificates.key_folder import Issued

TOPIC: Final = "Set up"

keys = typer.Typer(
    cls=Group,
    no_args_is_help=True,
    rich_markup_mode=None,
    help="Manage certificates for remote members.",
)

Dir = Annotated[Path, typer.Option("--dir", help="Folder of the keys.")]
Hosts = Annotated[
    list[str] | None,
    typer.Option("--host", help="Name or address of its machine; repeat, or separate by commas."),
]
Days = Annotated[int, typer.Option(help="Days of validity.")]
_HERE = Path("keys")


@completing.completer
def complete_roles(ctx: typer.Context, incomplete: str) -> completing.Choices:
    """The roles that a certificate can have."""
    from minerva_bus.security.credentials import ROLES

    return [(role, "") for role in ROLES]


@keys.command(cls=Command)
def init(
    dir: Dir = _HERE,
    host: Hosts = None,
    days: Days = 3650,
    json: Json = False,
) -> None:
    """Create a certificate authority and the coordinator's certificate."""
    folder = _folder(dir)
    made = folder.init(by_comma(host), days)
    until = _day(folder.now, days)
    if json:
        print_json({"folder": str(dir), "until": until, "coordinator": _plain(made, folder.now)})
        return
    print_result(f"{dir}: an authority until {until}, and {_shown(made, folder.now)}")
    print_result(
        f"keep {dir / 'ca.key'} secret: whoever has it can issue certificates for this world"
    )


@keys.command(cls=Command)
def issue(
    name: Annotated[str, typer.Argument(help="Name of the member or person.")],
    role: Annotated[
        list[str] | None,
        typer.Option(
            help="agent, generator, view, operator, coordinator, router; separated by commas.",
            autocompletion=complete_roles,
        ),
    ] = None,
    dir: Dir = _HERE,
    kinds: Annotated[
        list[str] | None, typer.Option(help="Only these agent kinds: AFox,ARabbit.")
    ] = None,
    events: Annotated[list[str] | None, typer.Option(help="Only these event types.")] = None,
    topics: Annotated[
        list[str] | None, typer.Option(help="Sensor topics on which it publishes; otherwise none.")
    ] = None,
    host: Hosts = None,
    days: Days = 365,
    family: Annotated[
        bool,
        typer.Option("--family", help="Valid for any number of members: NAME-a, NAME-b, ..."),
    ] = False,
    renew: Annotated[
        bool,
        typer.Option(
            "--renew", help="Replace the existing one, with the same rights unless given here."
        ),
    ] = False,
    json: Json = False,
) -> None:
    """Issue a certificate: copy NAME.pem, NAME.key and ca.pem to the member's machine."""
    from minerva_certificates.issuing import Wanted

    folder = _folder(dir)
    given = (role, host, kinds, events, topics)
    before = folder.issued().get(name) if renew else None
    # A renewed certificate must not grant more than before, so rights that are not given are kept.
    kept = [()] * len(given) if before is None else _purposes(before)
    fields = [
        old if words is None else by_comma(words) for words, old in zip(given, kept, strict=True)
    ]
    wanted = Wanted(*fields, days=days, family=family)
    _print_issued(folder.issue(name, wanted, renew=renew), folder.now, json)


@keys.command(cls=Command)
def revoke(
    name: Annotated[str, typer.Argument(help="Name in the certificate.")],
    dir: Dir = _HERE,
    json: Json = False,
) -> None:
    """Revoke a certificate, also in worlds that are running."""
    folder = _folder(dir)
    _print_issued(folder.revoke(name), folder.now, json)


@keys.command("list", cls=Command)
def list_(
    dir: Dir = _HERE,
    json: Json = False,
) -> None:
    """List certificates with their roles, state and validity."""
    folder = _folder(dir)
    issued = folder.issued().values()
    if json:
        print_json([_plain(each, folder.now) for each in issued])
        return
    print_table([_TITLES, *[_cells(each, folder.now) for each in issued]])


@keys.command(cls=Command)
def router(
    name: Annotated[str, typer.Argument(help="Name of the router's certificate.")],
    world: Annotated[str, typer.Argument(help="Name of the world.")],
    listen: Annotated[
        str, typer.Option(help="Endpoint at which the router listens.")
    ] = "tls/0.0.0.0:7447",
    dir: Dir = _HERE,
) -> None:
    """Print a zenohd configuration for a router that admits the members of a world."""
    from minerva_bus.errors import KeysError
    from minerva_bus.runtime.endpoints import check_listening
    from minerva_bus.runtime.session import tls_settings
    from minerva_bus.security.access import access_control
    from minerva_bus.security.credentials import ROUTER
    from minerva_bus.wire.keys import Keys

    check_listening(listen, keys=True, insecure=False)
    folder = _folder(dir)
    own = folder.credentials(name)
    if ROUTER not in own.roles:
        raise KeysError(
            f"the certificate of {name} is not for a router; issue one with --role router"
        )
    access = access_control(Keys(world), folder.rights().values(), [], carrier=True)
    config = {
        "mode": "router",
        "listen": {"endpoints": [listen]},
        "scouting": {"multicast": {"enabled": False}, "gossip": {"enabled": False}},
        "timestamping": {"enabled": False},
        "transport": {"link": {"tls": tls_settings(own)}},
        "access_control": dict(access),
    }
    print_result(dumps(config, indent=2))


_TITLES = ("name", "roles", "state", "until", "for")


def _cells(issued: Issued, now: datetime) -> tuple[str, ...]:
    """A line of the list."""
    rights = issued.rights
    limits = sorted([*rights.kinds, *rights.events, *rights.topics, *issued.hosts])
    roles = ", ".join(sorted(rights.roles))
    return rights.name, roles, issued.state(now), f"{issued.ends:%Y-%m-%d}", " ".join(limits)


def _plain(issued: Issued, now: datetime) -> dict[str, Any]:
    from minerva_bus.security.credentials import FAMILY

    rights = issued.rights
    return {
        "name": rights.name.removesuffix(FAMILY),
        "family": rights.name.endswith(FAMILY),
        "roles": sorted(rights.roles),
        "state": issued.state(now),
        "kinds": sorted(rights.kinds),
        "events": sorted(rights.events),
        "topics": sorted(rights.topics),
        "hosts": list(issued.hosts),
        "from": issued.begins.isoformat(),
        "until": issued.ends.isoformat(),
        "serial": f"{issued.serial:x}",
        "key": issued.key,
    }


def _purposes(issued: Issued) -> list[tuple[str, ...]]:
    """Roles, hosts, kinds, events and topics of a certificate."""
    rights = issued.rights
    limits = [tuple(sorted(names)) for names in (rights.kinds, rights.events, rights.topics)]
    return [tuple(sorted(rights.roles)), issued.hosts, *limits]


def _print_issued(issued: Issued, now: datetime, as_json: bool) -> None:
    if as_json:
        print_json(_plain(issued, now))
    else:
        print_result(_shown(issued, now))


def _shown(issued: Issued, now: datetime) -> str:
    name, roles, state, ends, confined = _cells(issued, now)
    only = f", for {confined}" if confined else ""
    return f"{name}: {roles}{only}; {state}, until {ends}"


def _day(now: datetime, days: int) -> str:
    # The type for dates ends with the year 9999.
    ends = min(now.timestamp() + 86400.0 * days, 253e9)
    return datetime.fromtimestamp(ends, UTC).date().isoformat()


def _folder(path: Path) -> AuthorityFolder:
    from minerva_certificates.issuing import AuthorityFolder

    return AuthorityFolder(path)
