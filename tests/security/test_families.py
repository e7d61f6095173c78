"""One certificate for many members: hosts-a, hosts-b ... join with that of hosts-*."""

import json
import signal

import pytest
import zenoh
from hypothesis import given
from hypothesis import strategies as st

from minerva_bus.errors import BusError
from minerva_bus.runtime.session import open_client
from minerva_bus.security.access import access_control
from minerva_bus.security.credentials import Rights, covers, overlap, rights_of
from minerva_bus.wire.keys import Keys as WorldKeys
from tests.patience import patience
from tests.runtime import yard
from tests.runtime.running import Run, ends_as_alone, here
from tests.security.secured import (
    Client,
    Joined,
    World,
    eventually,
    goes_on,
    keyed_world,
    present,
    refused,
    stolen,
)
from tests.security.test_access import may

HOST = {"roles": ("agent",), "family": True}
ISSUED = {
    "hosts": {**HOST, "kinds": ("AWalker",)},
    "gauges": {"roles": ("generator",), "topics": ("battery",), "family": True},
    "hostsx": {"roles": ("agent",)},
}
STRING = " · ".join(f"AWalker#{name}<x={x}>" for x, name in enumerate("abcdefghijklmnop"))
STARTS = st.text("ab-", min_size=1, max_size=4)
COMMON_NAMES = STARTS | STARTS.map(lambda start: f"{start}-*")


# --- names ---


@given(COMMON_NAMES, COMMON_NAMES, st.text("ab-", max_size=6))
def test_names_overlap_if_a_member_matches_both(first, other, member):
    """Zenoh's key expressions are the reference."""
    chunks = [zenoh.KeyExpr(name.replace("*", "$*")) for name in (first, other)]
    assert overlap(first, other) == overlap(other, first) == chunks[0].intersects(chunks[1])
    if member:
        assert covers(first, member) == chunks[0].intersects(zenoh.KeyExpr(member))


@given(st.sets(COMMON_NAMES, max_size=4), st.text("ab-", min_size=1, max_size=6))
def test_a_name_has_one_owner_and_revocation_takes_precedence(names, member):
    rights = {name: Rights(name, frozenset({"agent"}), revoked="b" in name) for name in names}
    covering = [right for name, right in rights.items() if covers(name, member)]
    held = rights_of(member, rights)
    assert (held is None) == (covering == [])
    assert held is None or held in covering
    assert held is None or held.revoked == any(right.revoked for right in covering)


@pytest.mark.parametrize("role", ["agent", "generator", "view", "operator"])
def test_the_rules_are_for_all_names_of_a_family_and_no_other(role):
    keys, family = WorldKeys("w"), Rights("hosts-*", frozenset({role}), topics=frozenset({"scan"}))
    access = access_control(keys, [family, Rights("hostsx", frozenset({"view"}))], [])
    for name, its in (("hosts-a", True), ("hosts-a-b.c", True), ("hosts", False),
                      ("hostsx", False), ("other", False), ("coordinator", False)):  # fmt: skip
        asked = [
            ("ingress", "put", keys.sent_by(name)),
            ("ingress", "liveliness_token", keys.alive(name)),
            ("ingress", "declare_subscriber", keys.to(name)),
            ("ingress", "query", f"minerva/w/ask/{name}"),
        ]
        if role == "generator":
            asked.append(("ingress", "put", keys.topic("scan", name)))
        if role == "operator":
            asked.append(("ingress", "query", f"minerva/w/control/{name}"))
        for flow, message, key in asked:
            assert may(access, "hosts-*", flow, message, key) == its, key
            assert not may(access, "hostsx", flow, message, key) or name == "hostsx"
    assert not may(access, "hosts-*", "ingress", "put", keys.sent_by("hosts-a/b"))


# --- a world ---


@pytest.fixture(scope="module")
def world(tmp_path_factory):
    path, _ = keyed_world(tmp_path_factory.mktemp("fam"), ISSUED, string=STRING, frames=0, rate=20)
    with World(path) as world:
        world.runs("steps", "walkers")
        yield world


def evolves(world, name):
    def answered():
        return world.members().get(name, {}).get("last_reply", -1)

    before = answered()
    eventually(lambda: answered() > before + 5, f"{name} has agents")


def left(world, name):
    eventually(lambda: world.members().get(name, {}).get("state") == "left", f"{name} is out")


def attach(world, door, name):
    who = ("--connect", door, "--world", world.name, "--keys", "keys/hosts.pem", "--name", name)
    return Run(world.folder, "attach", "yard:Walker", *who)


def test_two_of_a_family_attach_and_evolve_agents_and_one_leaves(world, door, keys):
    with (
        attach(world, door, "hosts-a") as first,
        Joined(world, door, keys.credentials("hosts-7d9f8b6c5-x2x7k"), agents=(yard.Walker,)),
    ):
        for name in ("hosts-a", "hosts-7d9f8b6c5-x2x7k"):
            present(world, name)
            evolves(world, name)
        first.kill(signal.SIGTERM)
        assert first.ends() == 0, first.text
        left(world, "hosts-a")
        evolves(world, "hosts-7d9f8b6c5-x2x7k")
        goes_on(world)


def test_a_family_certificate_admits_members_of_the_family_only(world, door, keys):
    with attach(world, door, "other") as run:
        assert run.ends() == 2
        assert "is for the family hosts-*, not for other; use --name hosts-other" in run.text
    base, names = f"minerva/{world.name}", ("hosts", "hostsx", "other", "steps", "coordinator")
    heard = []
    with (
        open_client("inside", world.endpoint()) as inside,
        open_client("hosts-z", door, own=keys.credentials("hosts-z")) as session,
    ):
        kept = inside.declare_subscriber(f"{base}/**", lambda sample: heard.append(str(sample.key_expr))
                                         if sample.payload.to_bytes() == b"evil" else None)  # fmt: skip
        tokens = [session.liveliness().declare_token(f"{base}/alive/{name}") for name in names]

        def says():
            for name in (*names, "hosts-z/b", "hosts-z"):
                session.put(f"{base}/from/{name}", b"evil")
            return heard

        eventually(says, "what it may say")
        assert set(heard) == {f"{base}/from/hosts-z"}
        kept.undeclare()
        del tokens
    assert not {"hosts", "hostsx", "other"} & set(world.members())
    assert world.members()["steps"]["state"] == "present"
    goes_on(world)


def test_a_name_outside_a_family_does_not_match(world, door, keys):
    """The name of the certificate only begins with the same text."""
    with (
        open_client("inside", world.endpoint()) as inside,
        open_client("hostsx", door, own=keys.credentials("hostsx")) as session,
    ):
        alive = f"minerva/{world.name}/alive"
        tokens = [session.liveliness().declare_token(f"{alive}/{name}")
                  for name in ("hosts-q", "hostsx")]  # fmt: skip
        there = eventually(
            lambda: [key for reply in inside.liveliness().get(f"{alive}/hosts*".replace("*", "$*"))
                     if reply.ok and "hostsx" in (key := str(reply.ok.key_expr))], "its own token"
        )  # fmt: skip
        assert there == [f"{alive}/hostsx"]
        assert "hosts-q" not in world.members()
        del tokens


@pytest.mark.parametrize(
    ("name", "service", "agents", "reason"),
    [
        ("hosts-c", yard.Noise(), (), "its certificate is for agent, not for generator"),
        ("hosts-d", None, (yard.Fragile,), "is for the agents AWalker, not for AFragile"),
        ("gauges-a", yard.Water(), (), "its certificate is for generator, not for view"),
    ],
)
def test_one_of_a_family_is_refused_by_its_own_name(
    world, door, keys, name, service, agents, reason
):
    before = refused(world, name)
    with Joined(world, door, keys.credentials(name), service, agents) as joined:
        assert reason in joined.ends()
    world.says(f"{name} │", reason)
    assert refused(world, name) > before


def test_a_query_needs_no_name(world, door):
    who = ("--connect", door, "--world", world.name, "--keys", "keys/hosts.pem")
    done = here(world.folder, "list", "--json", *who)
    assert "steps" in [row["member"] for row in json.loads(done.stdout)["members"]], done.stderr


def test_a_family_gives_no_orders_that_its_role_does_not_include(world, door, keys):
    with Client(door, world.name, keys.credentials("hosts-e")) as asked:
        assert asked.operator.status().world == world.name
        for question in ("stop", "pause"):
            with pytest.raises(BusError, match="hosts-e may not send commands"):
                asked.ask(question)
    world.says("hosts-e │ question rejected")
    with (
        Client(door, world.name, keys.credentials("hosts-f")) as asked,
        pytest.raises(BusError, match="hosts-f may not send commands"),
    ):
        asked.ask("stop")
    assert refused(world, "hosts-f") == 1
    assert "hosts-f │ question rejected" not in world.text  # Reported once per family.


@pytest.mark.parametrize(
    "name", ["hosts-$*", "hosts-a$*", "hosts-\x1b[2J", "hosts-ä", "hosts-" + "x" * 90]
)
def test_a_family_s_names_are_names(world, door, keys, name):
    """Wildcards and invalid names match Zenoh's rules, so the coordinator must reject them."""
    base, before = f"minerva/{world.name}", refused(world, "hosts-*")
    own = keys.credentials("hosts-a")
    with open_client("hosts-a", door, own=own) as session:
        token = session.liveliness().declare_token(f"{base}/alive/{name}")
        eventually(lambda: refused(world, "hosts-*") > before, "its token is refused")
        session.put(f"{base}/from/{name}", b"evil")
        eventually(lambda: refused(world, "hosts-*") > before + 1, "and what it says")
        for reply in session.get(
            f"{base}/ask/{name}", payload=b"\x81\xa3ask\xa6status", timeout=patience(5)
        ):
            assert b"a member's name has up to" in reply.ok.payload.to_bytes()
        token.undeclare()
    world.says("hosts-* │ messages of a member are ignored: a member's name has up to")
    assert name not in world.members()
    goes_on(world)


def test_revoking_a_family_revokes_all_its_members(world, door, keys):
    own, other = (keys.credentials(name) for name in ("hosts-g", "hosts-h"))
    with (
        Joined(world, door, own, agents=(yard.Walker,)) as first,
        Joined(world, door, other, agents=(yard.Walker,)) as second,
    ):
        present(world, "hosts-g")
        present(world, "hosts-h")
        keys.revoke("hosts")
        for name in ("hosts-g", "hosts-h"):
            left(world, name)
        for member in (first, second):
            assert "its certificate was revoked" in member.ends()
    with open_client("hosts-i", door, own=stolen(keys.folder, "hosts")) as session:
        world.says("hosts-* │ its certificate was revoked; its link", "is cut")
        session.liveliness().declare_token(f"minerva/{world.name}/alive/hosts-i")
        before = refused(world, "hosts-*")
        eventually(lambda: refused(world, "hosts-*") > before, "it is cut as it comes")
    assert world.members().get("hosts-i", {"state": "left"})["state"] == "left"
    goes_on(world)


def test_the_string_contains_none_of_it(world):
    ends_as_alone(world)
