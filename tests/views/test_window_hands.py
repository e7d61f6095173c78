"""From clicks and keys to orders for any world."""

import pytest
from window_world import BUGS, WORDS, Ledger, shown_by, status

from minerva_bus.errors import MisuseError
from minerva_services.geometry.picture import Picture
from minerva_services.views.window.actions import PauseAction, ResumeAction, StepAction
from minerva_services.views.window.controls import KEYS, Action, WindowControls, action_of
from minerva_services.views.window.order_types import check_named, order_types
from minerva_services.views.window.picking import Hit

ALL = ("eGo", "eBring", "eHaste", "eTurn", "eRain")


def hands(*orders, **options):
    made = WindowControls(WORDS, **options)
    made.update(status(*(orders or ALL)))
    return made


def test_roles_go_by_the_data_alone():
    roles = order_types(WORDS, ALL)
    assert (roles.click.name, roles.pair.name, roles.slide.name) == ("eGo", "eBring", "eHaste")
    rain = order_types(WORDS, ["eRain"])
    assert (rain.click, rain.pair, rain.slide) == (None, None, None)
    assert [event.name for event in rain.plain] == ["eRain"]
    assert order_types(WORDS, ALL, slide="eTurn").slide.name == "eTurn"


@pytest.mark.parametrize(
    ("options", "words"),
    [
        (("eGone", ""), "not an event type of the world; did you mean 'eGo'"),
        (("eBring", ""), "click is 'eBring'; its data must be one text"),
        (("", "eRain"), "slide is 'eRain'; its data must be one real"),
    ],
)
def test_an_option_that_names_another_type_is_refused(options, words):
    with pytest.raises(MisuseError, match=words) as caught:
        check_named("sprites", WORDS, *options)
    assert "\n" not in str(caught.value)


def test_a_click_on_a_label_sends_its_text_to_all():
    deed = hands().click(Hit(label="kitchen"))
    assert shown_by(deed).told == ['order eGo<place="kitchen">']
    assert shown_by(deed).said == 'sent eGo<place="kitchen">'


def test_or_to_the_agent_that_is_selected():
    made = hands()
    assert made.click(Hit(agent="b2")) is None
    assert made.selected == "b2"
    assert made.doing == "b2"
    deed = made.click(Hit(label="kitchen"))
    assert shown_by(deed).told == ['order eGo<place="kitchen"> to #b2']
    made.press(Action.DESELECT, BUGS)
    assert shown_by(made.click(Hit(label="attic"))).told == ['order eGo<place="attic">']


def test_a_click_has_no_effect_without_a_generator_for_orders():
    made = hands("eRain")
    assert made.click(Hit(label="kitchen")) is None
    assert made.click_aside(Hit(label="kitchen")) is None
    assert made.press(Action.MORE, BUGS) is None
    assert made.click(None) is None


def test_two_clicks_aside_send_two_labels():
    made = hands()
    assert made.click_aside(Hit(label="attic")) is None
    assert "attic" in made.doing
    deed = made.click_aside(Hit(label="hall"))
    assert shown_by(deed).told == ['order eBring<source="attic", target="hall">']
    assert made.source == ""
    made.click_aside(Hit(label="attic"))
    made.click_aside(None)
    assert made.click_aside(Hit(label="hall")) is None


def test_keys_pause_and_go_on_and_step():
    made = hands()
    assert made.press(Action.PAUSE, BUGS) == PauseAction()
    assert made.press(Action.PAUSE, BUGS) == ResumeAction()
    assert made.press(Action.STEP, BUGS) == StepAction()
    assert made.press(Action.PAUSE, BUGS) == ResumeAction()
    made.update(status(paused=True))
    assert made.press(Action.PAUSE, BUGS) == ResumeAction()
    actions = [shown_by(deed).told for deed in (PauseAction(), ResumeAction(), StepAction())]
    assert actions == [["pause"], ["resume"], ["step 1"]]


def test_a_held_key_changes_a_number_only(monkeypatch):
    """pygame reports a held key again and again, as when a loaded machine releases it late."""
    pygame = pytest.importorskip("pygame")
    from minerva_services.views.window.events import WindowInput

    monkeypatch.setenv("SDL_VIDEODRIVER", "dummy")
    pygame.display.init()
    made, ledger = hands(), Ledger(speed=0.5)
    window = WindowInput(made, None, lambda action: action and action.do(ledger))
    slash, up = {"key": pygame.K_SLASH, "unicode": "?"}, {"key": pygame.K_UP, "unicode": ""}

    def process(*events):
        shown = [pygame.event.Event(kind, key) for kind, key in events]
        monkeypatch.setattr(pygame.event, "get", lambda: shown)
        return window.process(BUGS)

    assert process((pygame.KEYDOWN, slash))
    assert not process((pygame.KEYDOWN, slash))
    assert made.helps
    process((pygame.KEYUP, slash), (pygame.KEYDOWN, slash))
    assert not made.helps
    process(*[(pygame.KEYDOWN, up)] * 3)
    assert [order.split("=")[1] for order in ledger.told] == ["0.6>", "0.7>", "0.8>"]


def test_keys_change_a_number_from_what_the_agent_has():
    made, ledger = hands(), Ledger(speed=0.5)
    for key in (Action.MORE, Action.MORE, Action.LESS):
        made.press(key, BUGS).do(ledger)  # the agent has not received it yet
    assert [order.split("=")[1] for order in ledger.told] == ["0.6>", "0.7>", "0.6>"]
    ledger.speed = 2.0  # set by another user
    made.press(Action.MORE, BUGS).do(ledger)
    assert ledger.told[-1] == "order eHaste<speed=2.1>"


def test_a_speed_is_never_below_zero():
    made = hands()
    assert shown_by(made.press(Action.LESS, BUGS), speed=0.05).told == ["order eHaste<speed=0>"]


def test_a_number_that_no_agent_has_begins_at_its_default():
    deed = hands(slide="eTurn").press(Action.MORE, Picture())
    assert shown_by(deed).told == ["order eTurn<angle=2.1>"]


def test_a_number_sends_an_order_without_data_that_people_may_send():
    made = WindowControls(WORDS)
    made.update(status("eGo", people=("eRain",)))
    assert dict(made.help)["1"] == "eRain"
    assert shown_by(made.send_plain("1")).told == ["order eRain"]
    assert made.send_plain("2") is None
    made.click(Hit(agent="b1"))
    assert shown_by(made.send_plain("1")).told == ["order eRain to #b1"]


def test_following():
    made = hands()
    made.press(Action.FOLLOW, BUGS)
    assert (made.selected, made.follows) == ("b1", True)
    made.stop_following()
    assert (made.selected, made.follows) == ("b1", False)
    made.click(Hit(agent="b2"), double=True)
    assert (made.selected, made.follows) == ("b2", True)
    made.press(Action.FOLLOW, BUGS)
    assert not made.follows
    nobody = hands()
    nobody.press(Action.FOLLOW, Picture())
    assert not nobody.follows


def test_the_help_lists_the_options_of_this_world():
    lines = dict(hands().help)
    assert lines["space"] == "pause or resume"
    assert lines["click a label"] == "eGo"
    assert lines["right-click two labels"] == "eBring"
    assert lines["up +"] == "eHaste: more speed"
    assert "click a label" not in dict(hands("eRain").help)
    assert not any("eHaste" in meaning for _, meaning in hands("eRain").help)


def test_each_key_does_one_thing():
    named = [key for keys in KEYS.values() for key in keys]
    assert len(named) == len(set(named))
    assert set(KEYS) == set(Action)
    assert action_of("SPACE") is Action.PAUSE
    assert action_of("q") is None
