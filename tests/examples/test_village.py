"""The village: plans, invitations, and life without a model."""

from __future__ import annotations

import re
import sys
from pathlib import Path

import pytest

from minerva_assistants.minds import eNoAnswer
from minerva_bus import Frame, evolve
from minerva_bus.errors import MinervaError
from minerva_messages import Conversation, Conversations, eMessage
from tests.runtime.running import here, summary

FOLDER = Path(__file__).resolve().parents[2] / "worlds" / "minerva_worlds" / "village"
README = (FOLDER / "README.md").read_text(encoding="utf-8")

sys.path.insert(0, str(FOLDER))

from village import (  # noqa: E402  # pyright: ignore[reportMissingImports]
    NAMES,
    Villager,
    eConsent,
    ePlan,
    eStep,
    scene,
    vocabulary,
)

ADA = 'trade="baker", friends=["bela", "cora"], home_x=1, home_y=1, x=1, y=1'


def lived(state, *events, number=0):
    """The villager after some events, and what it has emitted."""
    ada = vocabulary.read(f"AVillager#ada<{', '.join(filter(None, (ADA, state)))}>")
    evolved = evolve(ada, events, [Villager], Frame(number, 0.1))
    (node,) = evolved.scene
    emitted = [event for sent in evolved.emitted.values() for event in sent]
    return dict(zip(node.names, node.values, strict=True)), emitted


def test_a_villager_without_a_purpose_asks_for_a_plan():
    state, (asked,) = lived('hunger=80, action="work"', eStep())
    assert state["thinking"]
    assert (asked.type, asked.answer, asked.receivers) == ("eAsk", "ePlan", ("mind",))
    assert "hunger 80, tiredness 0, loneliness 0; most urgent: hunger" in asked.prompt
    assert lived('hunger=80, action="work", thinking=true', eStep())[1] == []


def test_a_villager_walks_on_while_it_waits():
    before, _ = lived('place="field", thinking=true')
    after, _ = lived('place="field", thinking=true', eStep())
    assert after["x"] > before["x"]


def test_a_plan_to_meet_is_an_invitation():
    plan = ePlan("meet", "inn", "bela", "Come!")
    state, (sent,) = lived("thinking=true", plan)
    assert (state["action"], state["place"], state["thinking"]) == ("meet", "inn", False)
    assert (sent.performative, sent.content, sent.receivers) == (
        "request",
        "Come! (inn)",
        ("bela",),
    )
    # Nobody can be invited who does not exist.
    assert lived("", ePlan("meet", "inn", "zeno", "Come!"))[1] == []
    assert lived("", ePlan("meet", "inn", "ada", "Come!"))[1] == []


def test_without_an_answer_a_villager_follows_its_needs():
    state, sent = lived("tiredness=90, thinking=true", eNoAnswer("backend"))
    assert (state["action"], state["place"], state["thinking"], sent) == (
        "sleep",
        "home",
        False,
        [],
    )


def test_an_invitation_is_accepted_or_refused_by_the_model():
    more = {"protocol": "fipa-request", "conversation_id": "bela/1", "sender": "bela"}
    call = eMessage("request", "Come! (square)", receivers=["ada"], **more)
    state, (asked,) = lived("", call)
    assert (asked.answer, asked.topic) == ("eConsent", "bela/1 bela")
    (talk,) = Conversations(state["talks"])
    assert isinstance(talk, Conversation)
    talks = f"talks={{{state['talks']}}}"
    for answer, act, action in (
        (eConsent(True, "Yes", "bela/1 bela"), "agree", "meet"),
        (eConsent(False, "No", "bela/1 bela"), "refuse", "work"),
        (eNoAnswer("time", "", "bela/1 bela"), "refuse", "work"),
    ):
        state, (sent,) = lived(talks, answer)
        assert (sent.performative, state["action"]) == (act, action)
    # An answer to an invitation that has ended is ignored.
    assert lived("", eConsent(True, "Yes", "bela/1 bela"))[1] == []


def test_the_village_lives_by_its_script_and_without_it(tmp_path):
    run = "run", FOLDER / "village.toml", "--in-process", "--rate", "0", "--json"
    scripted = summary(here(tmp_path, *run, "--frames", "500", "--record", "v.mcap"))
    assert scripted["answered"] > 50
    assert not {"invalid", "backend", "budget"} & set(scripted)
    end = here(tmp_path, "info", "v.mcap", "--string").stdout
    assert len(re.findall(r"AVillager#", end)) == len(NAMES)
    assert sum(map(int, re.findall(r"meetings=([0-9]+)", end))) > 0
    assert here(tmp_path, "replay", "v.mcap", "--recompute").returncode == 0
    # No model, but a village: every plan is refused by the budget.
    words = "--frames", "120", "--set", "llm.budget={ calls = 0 }", "--record", "n.mcap"
    assert summary(here(tmp_path, *run, *words))["budget"] > 0
    end = here(tmp_path, "info", "n.mcap", "--string").stdout
    assert 'action="eat"' in end


def test_a_villager_who_has_agreed_to_meet_ignores_a_plan():
    talk = 'PConversation<id="b/1", protocol="fipa-request", role="participant", peer="b", '
    talk += 'state="agreed", deadline=-1, content="", reply_with="", to=["b"]>'
    state, _ = lived(f'action="meet", thinking=true, talks={{{talk}}}', ePlan("work", "field"))
    assert (state["action"], state["thinking"]) == ("meet", False)


@pytest.mark.parametrize("count", [1, 13])
def test_a_village_of_the_wrong_size_is_an_error(count):
    with pytest.raises(MinervaError, match=f"village: {count} villagers; expected 2 to 12"):
        scene({"villagers": count})


def test_the_readme_shows_the_code():
    code = (FOLDER / "village.py").read_text(encoding="utf-8")
    blocks = re.findall(r"```python\n(.*?)```", README, re.S)
    assert len(blocks) == 3
    for block in blocks:
        assert block in code
