"""The SPADE bridge: its parts, and a conversation with a real agent in another process."""

import json
import os
import queue
import shutil
import signal
import socket
import subprocess
import sys
import threading
from pathlib import Path

import pytest

from minerva_bus import EventType, Vocabulary, WorldInfo
from minerva_bus.errors import MisuseError
from minerva_bus.grammar.scene import agents
from minerva_bus.log.record import Record
from minerva_bus.semantics.geometry import interpret
from minerva_bus.world.services import View
from minerva_messages import MESSAGES, OUTSIDE, Outside, PMail, TOutside, eMessage
from minerva_messages.message import NEVER
from minerva_messages.spade import Spade, service
from minerva_messages.spade.acl_messages import (
    Clock,
    InvalidMessage,
    Mailbox,
    event_of,
    metadata_of,
)
from minerva_messages.spade.addresses import Addresses
from minerva_services.bridging.testing import RunningBridge

ROOT = Path(__file__).resolve().parents[3]
RIG = Path(__file__).with_name("spade_rig.py")
YARD = Path(__file__).with_name("spade_yard.py")
INSIDE = Addresses.of("inside", ["clerk"], "localhost")
ALICE = Addresses.of("outside", {"alice": "Alice@example.org"}, "")
KNOWN = (INSIDE, ALICE)
CLOCK = Clock(frame=10, dt=0.5)


# --- addresses ------------------------------------------------------------------------------------


def test_addresses_of_a_list_a_table_and_a_pattern():
    assert INSIDE.jid("clerk") == "clerk@localhost"
    assert Addresses.of("inside", "a, b", "x.org").jid("b") == "b@x.org"
    assert ALICE.id("alice@example.org/phone") == "alice"
    pattern = Addresses.of("outside", "team.{id}@x.org", "")
    assert pattern.id("team.bob@x.org") == ""
    pattern.add_ids(["bob"])
    assert pattern.id("team.bob@x.org") == "bob"


@pytest.mark.parametrize(
    ("given", "domain", "why"),
    [
        (["a"], "", "set the option domain"),
        ({"a": "nowhere"}, "", "expected NAME@DOMAIN"),
        ("{id}", "", "expected NAME@DOMAIN"),
        ({"a": "x@y", "b": "X@y"}, "", "is the address of both #a and #b"),
        (["a b"], "x.org", "expected NAME@DOMAIN"),
        (["#a"], "x.org", "not an agent id"),
        ([1], "x.org", "must be a list of ids"),
    ],
)
def test_invalid_addresses(given, domain, why):
    with pytest.raises(MisuseError, match=why):
        Addresses.of("outside", given, domain)


@pytest.mark.parametrize(
    ("options", "why"),
    [
        ({"inside": []}, "inside is empty"),
        ({"inside": ["a"], "domain": "x.org", "server": "x:y"}, "expected HOST or HOST:PORT"),
        ({"inside": ["a"], "domain": "x.org"}, "set password_env or password_file"),
        ({"inside": {"a": "a@x.org"}}, "set outside"),
    ],
)
def test_options_that_cannot_be(options, why):
    with pytest.raises(MisuseError, match=why):
        Spade(**options)


# --- messages -------------------------------------------------------------------------------------


def test_a_message_there_and_back():
    message = eMessage(
        "cfp",
        "what?",
        language="minerva",
        protocol="fipa-contract-net",
        conversation_id="clerk/1",
        reply_with="q",
        reply_to=["clerk"],
        reply_by=14,
        sender="clerk",
        receivers=["alice"],
    )
    metadata = metadata_of(dict(message.data), KNOWN, CLOCK)
    assert {name: metadata[name] for name in sorted(metadata) if name != "reply-by"} == {
        "conversation-id": "clerk/1",
        "language": "minerva",
        "performative": "cfp",
        "protocol": "fipa-contract-net",
        "reply-to": "clerk@localhost",
        "reply-with": "q",
    }
    assert event_of("what?", "", metadata, "clerk", "alice", KNOWN, CLOCK) == message


def test_variants_written_by_other_tools():
    event = event_of("", "t1", {"performative": "ask-if"}, "alice", "clerk", KNOWN, CLOCK)
    assert (event.performative, event.conversation_id, event.reply_by) == ("query-if", "t1", NEVER)


@pytest.mark.parametrize(
    "metadata",
    [{}, {"performative": "shout"}, {"performative": "eos"}]
    + [{"performative": "inform", "reply-by": deadline} for deadline in ("soon", "0001-01-01")],
)
def test_messages_that_are_not_fipa(metadata):
    with pytest.raises(InvalidMessage):
        event_of("", "", metadata, "alice", "clerk", KNOWN, CLOCK)


def test_a_view_is_a_mailbox():
    mailbox = Mailbox()
    mail = PMail(3, "clerk", performative="inform", content="x")
    interpret(TOutside("alice")(mail) + TOutside("bob")(), mailbox)
    assert mailbox.there == ["alice", "bob"]
    assert [(letter.to, letter.frame, letter.sender) for letter in mailbox.mail] == [
        ("alice", 3, "clerk")
    ]


# --- the bridge without a server ------------------------------------------------------------------


def joined(monkeypatch, vocabulary=None, server=""):
    monkeypatch.setattr(service, "require", lambda *_: None)
    monkeypatch.setenv("YARD_PASSWORD", "secret")
    bridge = Spade(["clerk"], domain="localhost", password_env="YARD_PASSWORD", server=server)
    bridge.joined(WorldInfo("w", vocabulary or Vocabulary.of(*MESSAGES, *OUTSIDE), 0, 0.1))
    return bridge


def mail_view(frame, sender="clerk", to="alice"):
    return TOutside(to)(PMail(frame, sender, performative="inform"))


def test_an_event_is_forwarded_once(monkeypatch):
    bridge = joined(monkeypatch)
    for frame, since in ((7, 4), (8, 7), (8, 7), (8, 7), (9, 7), (10, 7), (11, 10), (15, 12)):
        bridge.show(View(frame, "eMail", mail_view(since)))
    assert bridge.report()["sent"] == 3


def test_a_message_without_address_is_reported_and_counted(monkeypatch, capsys):
    bridge = joined(monkeypatch)
    bridge.show(View(1, "eMail", mail_view(0, sender="boss")))
    bridge.show(View(2, "eMail", mail_view(1, sender="boss")))
    assert bridge.report()["unsent"] == 2
    assert capsys.readouterr().out.count("#boss has no account") == 1


def test_only_agents_in_the_string_send(monkeypatch):
    bridge = joined(monkeypatch)
    letter = service.XmppMessage(
        "eve@localhost", "clerk@localhost", "", "", {"performative": "inform"}
    )
    assert bridge._receive(letter) is None
    bridge.show(View(1, "eMail", TOutside("eve")()))
    assert bridge._receive(letter).sender == "eve"
    assert bridge._receive(letter._replace(to="nobody@localhost")) is None
    assert bridge._receive(letter._replace(metadata={})) is None
    far = {"performative": "inform", "reply-by": "9999-01-01T00:00:00+00:00"}
    bridge._clock = Clock(0, 1e-12)  # A frame number that exceeds the range of a message.
    assert bridge._receive(letter._replace(metadata=far)) is None
    figures = bridge.report()
    assert (figures["strangers"], figures["garbage"]) == (2, 2)


def test_a_password_that_is_not_there(monkeypatch, tmp_path):
    monkeypatch.delenv("NO_PASSWORD", raising=False)
    with pytest.raises(MisuseError, match="variable NO_PASSWORD is not set"):
        Spade(["a"], domain="x.org", password_env="NO_PASSWORD").open()
    missing = str(tmp_path / "none")
    with pytest.raises(MisuseError, match="No such file"):
        Spade(["a"], domain="x.org", password_file=missing).open()


def test_a_world_without_such_messages_is_refused(monkeypatch):
    with pytest.raises(MisuseError, match=r"needs \*MESSAGES and \*OUTSIDE"):
        joined(monkeypatch, Vocabulary.of(*MESSAGES))
    with pytest.raises(MisuseError, match="use \\*MESSAGES"):
        joined(monkeypatch, Vocabulary.of(EventType("eMessage"), *OUTSIDE[1:]))


# --- with a real SPADE agent ----------------------------------------------------------------------


class Rig:
    """The process with the server and the agent; `lines` is its output."""

    def __init__(self, folder):
        self.process = subprocess.Popen(
            [sys.executable, str(RIG), str(folder)],
            stdin=subprocess.DEVNULL,
            stdout=subprocess.PIPE,
            stderr=subprocess.DEVNULL,
            text=True,
            start_new_session=True,
        )
        self.lines = queue.SimpleQueue()
        threading.Thread(target=self._read, daemon=True).start()

    def _read(self):
        for line in self.process.stdout:
            self.lines.put(line)

    def port(self):
        return int(self.lines.get().split()[1])

    def close(self):
        os.killpg(self.process.pid, signal.SIGKILL)  # The server has child processes.
        self.process.wait()


@pytest.fixture
def rig(tmp_path):
    pytest.importorskip("spade", reason="needs SPADE: pip install 'minerva-bus[spade]'")
    folder = tmp_path / "server"
    folder.mkdir()
    made = Rig(folder)
    yield made
    made.close()


def test_a_contract_net_with_a_spade_agent(rig, tmp_path, monkeypatch):
    pytest.importorskip("mcap")
    monkeypatch.syspath_prepend(str(YARD.parent))
    from spade_yard import WORLD

    shutil.copy(YARD, tmp_path)
    (tmp_path / "yard.toml").write_text(WORLD, encoding="utf-8")
    packages = os.pathsep.join(str(ROOT / name) for name in ("", "services", "agents"))
    monkeypatch.setenv("PYTHONPATH", packages)
    monkeypatch.setenv("MINERVA_RUNTIME_DIR", str(tmp_path / "run"))
    monkeypatch.setenv("YARD_PASSWORD", "secret")
    port = rig.port()
    done = subprocess.run(
        [sys.executable, "-m", "minerva_bus.cli.main", "run", "yard.toml", "--port", str(port)]
        + ["--record", "yard.mcap"],
        cwd=tmp_path,
        capture_output=True,
        text=True,
    )
    assert done.returncode == 0, done.stderr + done.stdout
    with Record(tmp_path / "yard.mcap") as record:
        string = record.last()[1]
    state = {agent.id: dict(agent.state) for agent in agents(string)}
    assert state["clerk"]["served"] == 1
    assert state["buyer"]["heard_from"] == ("alice propose 42", "alice inform delivered")
    heard = [json.loads(rig.lines.get()) for _ in range(5)]
    assert [message["metadata"]["performative"] for message in heard] == [
        *("inform", "agree", "inform", "cfp", "accept-proposal")
    ]
    assert heard.pop(0)["body"] == "open"
    assert heard[1]["body"] == "done: a stamp"
    assert {message["metadata"]["conversation-id"] for message in heard[:2]} == {"stamps"}
    assert {message["metadata"]["in-reply-to"] for message in heard[:2]} == {"q1"}
    assert heard[2]["from"] == "buyer@localhost"
    assert heard[2]["body"] == 'PJob<what="käse & brot">'
    assert heard[2]["thread"] == heard[2]["metadata"]["conversation-id"] == "buyer/1"
    assert "reply-by" in heard[2]["metadata"]
    assert Outside.kind.name in str(string)


def test_a_missing_server_is_reported_and_tried_again(monkeypatch):
    pytest.importorskip("spade", reason="needs SPADE: pip install 'minerva-bus[spade]'")
    with socket.create_server(("localhost", 0)) as taken:
        port = taken.getsockname()[1]
    bridge = joined(monkeypatch, server=f"localhost:{port}")
    bridge.show(View(1, "eMail", mail_view(0)))
    with RunningBridge(bridge) as running:
        running.wait_for(lambda: running.counted("failures") >= 2, "it tries again")
        assert "the XMPP server" in running.state
        assert running.counted("sent") == 1
