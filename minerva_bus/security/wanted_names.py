"""Checks of the name and the rights of a certificate before it is issued."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Final

from minerva_bus.errors import KeysError, MisuseError, nearest
from minerva_bus.security.certificates import Wanted
from minerva_bus.security.credentials import HUB, ROLES, SERVERS, overlap
from minerva_bus.wire.keys import COORDINATOR, checked_name, is_name

AUTHORITY: Final = "ca"
REVOKED: Final = "crl"


def check_wanted(name: str, wanted: Wanted) -> None:
    """Raises KeysError if a certificate cannot have this name with these rights."""
    try:
        checked_name(name, "a certificate")
    except MisuseError as error:
        raise KeysError(str(error)) from None
    for role in wanted.roles:
        if role not in ROLES:
            hint = nearest(role, list(ROLES), f"there are {', '.join(ROLES)}")
            raise KeysError(f"--role: there is no role {role!r}{hint}")
    if not wanted.roles:
        raise KeysError(f"--role is missing; roles are {', '.join(ROLES)}")
    if (name == COORDINATOR) != (HUB in wanted.roles) or name in (AUTHORITY, REVOKED):
        raise KeysError(f"{name} cannot be {', '.join(wanted.roles)}: choose another name")
    if wanted.family and not SERVERS.isdisjoint(wanted.roles):
        raise KeysError(f"{', '.join(wanted.roles)}: this role cannot have a family")
    if wanted.family and not is_name(f"{name}-a"):
        raise KeysError(f"{name} is too long for a family, whose members' names begin with it")
    if wanted.days < 1:
        raise KeysError(f"--days must be a whole number from 1, not {wanted.days}")


def check_alone(name: str, others: Iterable[str], otherwise: str) -> None:
    """Raises KeysError if two certificates are valid for the same member."""
    for other in others:
        if overlap(name, other):
            raise KeysError(f"{name} and {other} have names in common: {otherwise}")


def check_case(name: str, others: Iterable[str]) -> None:
    """Raises KeysError if a file system without letter case takes two names for the same."""
    for other in others:
        if other != name and other.casefold() == name.casefold():
            raise KeysError(
                f"{name} and {other} differ in the case of letters only, and some file systems take"
                " their files for the same: choose another name"
            )
