"""When members take part: the texts of `when`, their values, and what is not possible."""

import hypothesis.strategies as st
import pytest
from hypothesis import given

from minerva_bus import Device, Generator
from minerva_bus.errors import MisuseError
from minerva_bus.frame.member import Member
from minerva_bus.world.service_attributes import when_of
from minerva_bus.world.when import Participation, When

TIMES = {
    "": When(),
    "in step": When(Participation.IN_STEP),
    "on orders": When(Participation.ON_ORDERS),
    "freely": When(Participation.FREELY),
    "each frame": When(every=1),
    "each 10 frames": When(every=10),
    "at 25 Hz": When(rate=25.0),
    "at 0.001 Hz": When(rate=0.001),
    "freely, each 2 frames": When(Participation.FREELY, every=2),
    "in step, at 29.97002997 Hz": When(Participation.IN_STEP, rate=29.97002997),
}


@pytest.mark.parametrize("text", TIMES)
def test_a_text_and_its_value(text):
    assert When.read(text) == TIMES[text]
    assert str(TIMES[text]) == text


def test_other_texts_have_the_same_value():
    assert When.read("each 1 frames") == When(every=1)
    assert When.read("each 5 frames, in step") == When(Participation.IN_STEP, every=5)


@given(st.sampled_from(Participation), st.floats(0, allow_infinity=False, exclude_min=True))
def test_a_rate_keeps_every_bit(asked, rate):
    assert When.read(str(When(asked, rate=rate))).rate == rate


@pytest.mark.parametrize(
    ("text", "problem"),
    [
        (
            "lockstep",
            '"lockstep" is not possible; it may have "in step", "on orders", "freely", "ea',
        ),
        ("each 5 frame", '"each 5 frame" is not possible'),
        ("freely,each frame", "is not possible"),
        ("each frame, ", '"" is not possible'),
        ("at -1 Hz", '"at -1 Hz" is not possible'),
        ("at inf Hz", '"at inf Hz" is not possible'),
        ("at 1e999 Hz", 'expected a number above 0 in "at 1e999 Hz"'),
        ("at 0 Hz", 'expected a number above 0 in "at 0 Hz"'),
        ("each 0 frames", 'expected a number above 0 in "each 0 frames"'),
        ("in step, freely", 'choose one of "in step" and "freely"'),
        ("at 5 Hz, each 2 frames", 'choose one of "at 5 Hz" and "each 2 frames"'),
    ],
)
def test_what_is_not_possible(text, problem):
    with pytest.raises(MisuseError) as caught:
        When.read(text)
    assert str(caught.value).startswith(f'when = "{text}": ')
    assert problem in str(caught.value)


class Rain(Generator, events=("eRain",)):
    pass


class Screen(Device, draws=("eShow",)):
    def show(self, view):
        pass


class Both(Screen, Rain):
    pass


@pytest.mark.parametrize(
    ("cls", "declared", "when"),
    [
        (Rain, "", "in step"),
        (Rain, "freely", "freely"),
        (Rain, "on orders", "on orders"),
        (Rain, "each 3 frames", "in step, each 3 frames"),
        (Screen, "", ""),
        (Screen, "at 20 Hz", "at 20 Hz"),
        (Both, "", "in step"),
        (Both, "each 5 frames", "in step, each 5 frames"),
        (Both, "freely, each frame", "freely, each frame"),
    ],
)
def test_a_generator_is_in_step_unless_it_says_otherwise(cls, declared, when):
    made = type("Made", (cls,), {}, when=declared)()
    assert str(when_of(made)) == when
    assert str(Member("made", made).hello().when) == when


@pytest.mark.parametrize(
    ("cls", "when", "problem"),
    [
        (Screen, "on orders", 'when = "on orders" is for generators, and it is a device'),
        (Screen, "in step, each frame", "is for generators, and it is a device"),
        (Rain, "at 5 Hz", 'its `when` is "in step, at 5 Hz", but it draws no views'),
        (Rain, "freely, each frame", "but it draws no views and is not in step"),
        (Both, "on orders", "so it has events on orders only, but it draws views"),
    ],
)
def test_times_that_a_service_cannot_have(cls, when, problem):
    made = type("Made", (cls,), {}, when=when)()
    with pytest.raises(MisuseError) as caught:
        Member("made", made)
    assert str(caught.value).startswith("Made: ")
    assert problem in str(caught.value)


@pytest.mark.parametrize(
    ("name", "value", "reason"),
    [
        ("topics", ("sight",), "subscribes to topics"),
        ("publishes", ("sight",), "publishes on topics"),
        ("takes_orders", lambda self: ("eRain",), "takes orders"),
    ],
)
def test_a_generator_that_is_not_always_asked_has_no_inputs(name, value, reason):
    made = type("Made", (Rain,), {name: value}, when="each 2 frames")()
    with pytest.raises(MisuseError, match=f"so some frames do not ask it, but it {reason}"):
        Member("made", made)


@pytest.mark.parametrize("when", ["often", 5])
def test_a_class_argument_is_checked_at_once(when):
    with pytest.raises(MisuseError, match=r"^Odd: when"):
        type("Odd", (Rain,), {}, when=when)
