"""extensions/messages/messages.md: its tables match the code, and its example agents converse."""

import re
import tomllib
from pathlib import Path

import pytest

import minerva_messages
from minerva_bus import Vocabulary
from minerva_messages.acts import ACTS
from minerva_messages.kqml import NEAREST, performative_of
from minerva_messages.protocols import PROTOCOLS
from minerva_messages.spade import Spade

DOCUMENT = (Path(__file__).parents[1] / "messages.md").read_text(encoding="utf-8")


def section(title):
    """The rows of the table of a section, as lists of cells."""
    (text,) = re.findall(rf"^#+ {title}.*?\n(.*?)(?=^#|\Z)", DOCUMENT, re.M | re.S)
    rows = [line.strip()[1:-1].split("|") for line in text.splitlines() if line.startswith("|")]
    return [[cell.strip().strip("`") for cell in row] for row in rows[2:]]


def block(kind):
    (text,) = re.findall(rf"^```{kind}\n(.*?)^```$", DOCUMENT, re.M | re.S)
    return text


def test_the_acts():
    assert [row[0] for row in section("Acts")] == list(ACTS)


def test_the_parameters():
    text = "\n".join("|".join(row) for row in section("The parameters of a message"))
    names = {name.replace("_", "-") for name in minerva_messages.eMessage.fields.names}
    assert names | {"sender", "receiver"} == {
        *re.findall(r"[a-z-]+", " ".join(row.split("|")[0] for row in text.splitlines()))
    }


@pytest.mark.parametrize("protocol", PROTOCOLS.values(), ids=sorted(PROTOCOLS))
def test_the_protocols(protocol):
    (name,) = [
        name for name in minerva_messages.__all__ if getattr(minerva_messages, name) is protocol
    ]
    assert section(f"{name}: {protocol.name}, {protocol.source}") == [
        [str(cell) for cell in step] for step in protocol.own
    ]


def test_kqml():
    assert {row[0]: (row[1], row[2]) for row in section("KQML")} == {
        performative: (
            str(act) if act else "none",
            "yes" if act and performative_of(act) == performative else "",
        )
        for performative, act in NEAREST.items()
    }
    lost = re.search(r"; (`accept-proposal`.*?) have no counterpart", DOCUMENT, re.DOTALL)
    assert {act for act in ACTS if performative_of(act) is None} == {
        *re.findall(r"`([a-z-]+)`", lost[1])
    }


def test_its_agents_converse():
    names = {"__name__": "printing"}
    exec(block("python printing"), names)
    exec(block("python tried"), names)


def test_its_bridge_can_be_made():
    table = tomllib.loads(block("toml outside"))
    options = {
        name: setting
        for name, setting in table["process"]["xmpp"].items()
        if name not in ("service", "speaks_for")
    }
    assert Spade(**options).generates() == ("eMessage",)
    Vocabulary.of(*minerva_messages.MESSAGES, *minerva_messages.OUTSIDE)
    compile(block("python spade"), "spade", "exec")
