"""`minerva conversation`: the messages between a record's agents as a diagram."""

import io
import json
import os
import subprocess
import sys
from pathlib import Path
from xml.etree import ElementTree as ET

import pytest

from extensions.messages.tests.auction import WORLD, auction
from minerva_bus import Agent, EventType, Vocabulary
from minerva_bus.errors import DamagedRecordWarning, MinervaError, RecordError
from minerva_bus.frame.messages import FrameRecord
from minerva_bus.frame.world_state import WorldSpec
from minerva_bus.log.entries import RecordHeader
from minerva_messages import MESSAGES, eMessage
from minerva_messages.conversation_diagram import show_conversation
from minerva_messages.exchanges import MOST
from tests.log.recorded_runs import bytes_of
from tests.log.test_damaged import CHUNK, flipped, parts

mcap = pytest.importorskip("mcap")

ROOT = Path(__file__).resolve().parents[3]
eStep = EventType("eStep")


class Rock(Agent, symbol="ARock"):
    pass


def said(act, sender, *receivers, content="", conversation="", **more):
    return eMessage(
        act, content, sender=sender, receivers=receivers, conversation_id=conversation, **more
    )


TALK = [
    (0, eStep()),
    (3, said("cfp", "boss", "b", "c", content="two; <lines>\n#1", conversation="boss/1")),
    (4, said("refuse", "c", "boss", conversation="boss/1", content="no")),
    (4, said("propose", "b", "boss", conversation="boss/1", content="7")),
    (5, said("inform", "c", content="hello all", protocol="x")),
    (6, said("inform", "", "c", content="from people", reply_by=9)),
    (7, said("inform", "c", "c", content="a note", conversation="c/1")),
]
UNWRITABLE = "a\x00b\x1b\ufffe<"


@pytest.fixture
def record(tmp_path):
    """Write a record of the given events, each with its frame."""

    def write(events):
        from minerva_bus.log.record_writer import RecordWriter

        vocabulary = Vocabulary.of(*MESSAGES, eStep, Rock)
        world = WorldSpec("quarry", scene=vocabulary.read("ARock#boss"), vocabulary=vocabulary)
        stream = io.BytesIO()
        writer = RecordWriter(stream, RecordHeader(world, "", 0.0, {}, began=10**18))
        for frame in sorted({frame for frame, _ in events}):
            those = tuple(event for when, event in events if when == frame)
            done = FrameRecord(frame, those, {}, world.scene.digest)
            writer.frame(done, world.scene, 0.0, {})
        writer.finish()
        path = tmp_path / "run.mcap"
        path.write_bytes(stream.getvalue())
        return path

    return write


def test_mermaid(record, capsys):
    show_conversation(record(TALK), "", None, False)
    assert capsys.readouterr().out.splitlines() == [
        "sequenceDiagram",
        "    participant a0 as boss",
        "    participant a1 as b",
        "    participant a2 as c",
        "    participant a3 as everybody",
        "    participant a4 as somebody outside",
        "    Note over a0,a4: frame 3",
        "    a0->>a1: cfp: two#59; #60;lines#62; #35;1",
        "    a0->>a2: cfp: two#59; #60;lines#62; #35;1",
        "    Note over a0,a4: frame 4",
        "    a2->>a0: refuse: no",
        "    a1->>a0: propose: 7",
        "    Note over a0,a4: frame 5",
        "    a2->>a3: inform: hello all",
        "    Note over a0,a4: frame 6",
        "    a4->>a2: inform: from people (by frame 9)",
        "    Note over a0,a4: frame 7",
        "    a2->>a2: inform: a note",
    ]


def test_one_conversation(record, capsys):
    show_conversation(record(TALK), "boss/1", None, True)
    answer = json.loads(capsys.readouterr().out)
    assert answer["agents"] == ["boss", "b", "c"]
    assert [message["performative"] for message in answer["messages"]] == [
        "cfp",
        "refuse",
        "propose",
    ]
    assert answer["messages"][0]["receivers"] == ["b", "c"]
    assert answer["messages"][0]["content"] == "two; <lines>\n#1"


def test_a_picture_of_what_xml_cannot_hold_is_xml_all_the_same(record, tmp_path):
    talk = [(1, said("inform", "b", "c", content=UNWRITABLE))]
    show_conversation(record(talk), "", tmp_path / "talk.svg", False)
    root = ET.fromstring((tmp_path / "talk.svg").read_text(encoding="utf-8"))
    assert "a\ufffdb\ufffd\ufffd<" in "".join(root.itertext())


def test_svg(record, tmp_path, capsys):
    output = tmp_path / "talk.svg"
    show_conversation(record(TALK), "", output, False)
    assert capsys.readouterr().out == f"{output}\n"
    root = ET.fromstring(output.read_text(encoding="utf-8"))
    texts = [
        "".join(element.itertext()) for element in root.iter("{http://www.w3.org/2000/svg}text")
    ]
    assert {"boss", "b", "c", "everybody", "frame 3", "frame 7"} <= set(texts)
    assert any(text.endswith("cfp: two; <lines> #1") for text in texts)
    width, height = (float(root.get(name)) for name in ("width", "height"))
    for line in root.iter("{http://www.w3.org/2000/svg}line"):
        assert 0 <= float(line.get("x2")) <= width
        assert 0 <= float(line.get("y2")) <= height


def test_mermaid_into_a_file(record, tmp_path):
    output = tmp_path / "talk.mmd"
    show_conversation(record(TALK), "c/1", output, False)
    assert output.read_text(encoding="utf-8").startswith("sequenceDiagram\n")


def test_a_record_without_messages(record):
    with pytest.raises(RecordError, match="agents exchanged no messages"):
        show_conversation(record([(0, eStep())]), "", None, False)


def test_a_conversation_that_is_not_there(record):
    with pytest.raises(RecordError, match=r"did you mean 'boss/1'.*there are boss/1, c/1"):
        show_conversation(record(TALK), "bos/1", None, False)
    alone = record([(0, said("inform", "a", "b"))])
    with pytest.raises(RecordError, match="no conversation 'x'; no message names one"):
        show_conversation(alone, "x", None, False)


def test_too_many_for_a_picture(record, capsys):
    long = record(
        [(n, said("inform", "a", "b", conversation=f"a/{n % 20}")) for n in range(MOST + 1)]
    )
    with pytest.raises(RecordError, match=r"choose one with --conversation: .* and 12 more"):
        show_conversation(long, "", None, False)
    show_conversation(long, "", None, True)
    assert len(json.loads(capsys.readouterr().out)["messages"]) == MOST + 1


@pytest.mark.parametrize("name", ["talk.png", "talk"])
def test_other_pictures_are_refused(record, tmp_path, name):
    with pytest.raises(MinervaError, match=r"ends in \.svg or \.mmd"):
        show_conversation(record(TALK), "", tmp_path / name, False)


def test_an_unwritable_folder(record, tmp_path):
    with pytest.raises(MinervaError, match=r"cannot write .*x\.svg: No such file"):
        show_conversation(record(TALK), "", tmp_path / "nowhere" / "x.svg", False)


def test_damage_that_took_all_messages_is_named(tmp_path):
    broken = bytes_of("meadow")
    for at, _ in parts(broken, CHUNK)[1:]:
        broken = flipped(broken, at + 100)
    (tmp_path / "broken.mcap").write_bytes(broken)
    with (
        pytest.warns(DamagedRecordWarning, match="is damaged: bytes .*; lost: all from frame 0 on"),
        pytest.raises(MinervaError, match="there is no eMessage"),
    ):
        show_conversation(tmp_path / "broken.mcap", "", None, as_json=False)


def test_a_missing_record(tmp_path):
    with pytest.raises(MinervaError, match=r"no\.mcap"):
        show_conversation(tmp_path / "no.mcap", "", None, False)


def test_a_contract_net_goes_on_from_its_record(tmp_path, capsys):
    (tmp_path / "auction.toml").write_text(WORLD, encoding="utf-8")
    environment = os.environ | {
        "PYTHONPATH": os.pathsep.join(str(ROOT / name) for name in ("", "services", "agents")),
        "MINERVA_RUNTIME_DIR": str(tmp_path / "run"),
    }

    def minerva(*words):
        done = subprocess.run(
            [sys.executable, "-m", "minerva_bus", *words],
            cwd=tmp_path,
            env=environment,
            capture_output=True,
            text=True,
        )
        assert done.returncode == 0, done.stderr
        return done.stdout

    run = ["--in-process", "--json"]
    minerva("run", "auction.toml", "--frames", "4", "--record", "a.mcap", *run)
    again = json.loads(minerva("run", "--resume", "a.mcap", "--frames", "40", *run))["digest"]
    assert again == auction()[0][-1].digest.hex()
    show_conversation(tmp_path / "a.mcap", "s/1", None, True)
    assert json.loads(capsys.readouterr().out)["title"] == "auction: s/1, fipa-contract-net"
