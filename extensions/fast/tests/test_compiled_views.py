"""Compiled views give the strings of the methods themselves, and refuse what they cannot show."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

pytest.importorskip("numba")

from minerva_bus import (
    EMPTY,
    Agent,
    Disc,
    EventType,
    Label,
    Metres,
    Motion,
    Primitive,
    Transformation,
    view,
    visualize,
)
from minerva_bus.grammar.columns import has_columns
from minerva_bus.grammar.printer import scene_digest
from minerva_bus.grammar.scene import Scene
from minerva_bus.world.agent import ActivityError
from minerva_bus.world.class_declaration import NotCompilable

ePicture = EventType("ePicture", zoom=float, visual=True)
TAt = Transformation("TAt", Motion(x="x", y="y"), x=Metres, y=Metres)
TTurn = Transformation("TTurn", angle=float)
TGroup = Transformation("TGroup")
PSpot = Primitive("PSpot", Disc("size"), size=Metres, kind=int, color=str)
PName = Primitive("PName", Label("text"), text=str)
PDot = Primitive("PDot")
RED = "red"


def doubled(x):
    return x * 2


def make(compiled):
    class Fox(Agent, symbol="AFox"):
        x: float = 0.0
        y: float = 0.0
        age: int = 0
        sick: bool = False
        name: str = "a"

        @view("ePicture", compiled=compiled)
        def picture(self, picture):
            color = RED if self.sick else "green"
            if self.age < 0:
                return EMPTY
            if self.age > 90:
                return PDot()
            if self.name == "b":
                where = self.x / self.age
                return TAt(where, self.y)(PName(self.id)) + TTurn(angle=1.0)(PName(text=self.name))
            if self.age > 50:
                return TAt(doubled(self.x), 1)(PDot())
            size = picture.zoom * abs(self.x) + 0.1
            return TAt(x=self.x, y=-self.y)(TTurn(0.5)(PSpot(size, self.age % 7, color)))

    return Fox


PLAIN, COMPILED = make(False), make(True)


def picture(cls, agents, zoom=2.0, condition=""):
    """The view of columns, or the text of the error."""
    scene = cls.many("f", len(agents["x"]), **agents)
    event = ePicture(zoom=zoom, condition=condition)
    try:
        return visualize(scene, [event], [cls])
    except ActivityError as error:
        return str(error)


def same(agents, condition=""):
    plain, compiled = (picture(cls, agents, condition=condition) for cls in (PLAIN, COMPILED))
    if isinstance(plain, str) or isinstance(compiled, str):
        assert plain == compiled
        return plain
    assert str(plain) == str(compiled)
    assert scene_digest(plain) == scene_digest(compiled)
    return compiled


def foxes(ages, names=("a",), count=40):
    rows = np.arange(count)
    return {
        "x": np.linspace(-3, 3, count),
        "y": rows * 0.25,
        "age": np.resize(ages, count),
        "sick": rows % 3 == 0,
        "name": np.resize(np.array(names, object), count),
    }


@pytest.mark.parametrize("ages", [[1, 8], [-1], [99], [60], [-1, 8], [99, -1, 60, 8]])
@pytest.mark.parametrize("names", [("a",), ("b",), ("a", "b", "c")])
def test_a_compiled_view_gives_the_string_of_the_method(ages, names):
    same(foxes(ages, names))
    same(foxes(ages, names), condition="y > 3")


def test_views_of_one_form_are_columns_without_a_call_of_the_method(monkeypatch):
    monkeypatch.setattr(COMPILED, "views", {"ePicture": None})
    shown = picture(COMPILED, foxes([1, 8]))
    assert has_columns(shown)
    assert str(shown) == str(picture(PLAIN, foxes([1, 8])))


def test_attributes_that_are_shown_unchanged_are_not_copied():
    outputs = COMPILED.accelerator._views.program("ePicture").outputs
    assert [dict(each.shared) for each in outputs] == [
        {},
        {"1": "y", "2": "id", "4": "name"},
        {},
        {"0": "x"},
    ]


def test_a_view_gets_only_what_it_computes_with():
    class Bird(Agent, symbol="ABird"):
        x: Metres = 0.0
        y: Metres = 0.0
        size: Metres = 1.0
        name: str = ""

        @view("ePicture", compiled=True)
        def picture(self, picture):
            if self.size > 2:
                return TAt(self.x, self.y)(PName(self.id))
            return TTurn(0.5)(PName(self.name))

    program = Bird.accelerator._views.program("ePicture")
    assert [each.name for each in program.reads] == ["size", "x", "y"]
    assert program.given == ()
    birds = {"x": np.arange(40.0), "name": np.array(["n"] * 40)}
    for sizes in (np.ones(40), np.full(40, 3.0), np.arange(40.0)):
        scene = Bird.many("b", 40, size=sizes, **birds)
        expected = [visualize(Scene((node,)), [ePicture(zoom=1.0)], [Bird]) for node in scene.nodes]
        assert str(visualize(scene, [ePicture(zoom=1.0)], [Bird])) == " · ".join(map(str, expected))


def test_an_error_is_that_of_the_method():
    assert "ZeroDivisionError" in same(foxes([0], ("b",)))


numbers = st.floats(-1e6, 1e6) | st.sampled_from([0.0, -0.0, 1e300])


@settings(max_examples=40, deadline=None)
@given(st.data())
def test_compiled_views_are_the_methods(data):
    """The law: θ compiled = θ, for any agents."""
    count = data.draw(st.integers(32, 50))
    column = lambda values: data.draw(st.lists(values, min_size=count, max_size=count))  # noqa: E731
    same(
        {
            "x": np.array(column(numbers)),
            "y": np.array(column(numbers)),
            "age": np.array(column(st.sampled_from([-2, 0, 1, 7, 55, 95]))),
            "sick": np.array(column(st.booleans())),
            "name": np.array(column(st.sampled_from(["a", "b", ""])), object),
        }
    )


def no_result(self, picture):
    if self.x > 0:
        return EMPTY


def changing(self, picture):
    self.x = 1.0
    return EMPTY


def a_group(self, picture):
    return TGroup()(PName("a"))


def two_in_a_scope(self, picture):
    return TAt(1, 2)(PDot() + PName("a"))


def mixed_sum(self, picture):
    return PDot() + PName("a")


def a_number(self, picture):
    return self.x


def a_wrong_type(self, picture):
    return PName(self.x)


REFUSED = {
    no_result: ("a path without a result", "return EMPTY"),
    changing: ("a view that changes attributes", "local variable"),
    a_group: ("TGroup without parameters", "default"),
    two_in_a_scope: ("this result of a view", "TAt"),
    mixed_sum: ("with and without parameters", "parameter"),
    a_number: ("this result of a view", "EMPTY"),
    a_wrong_type: ("text is declared as", "convert"),
}


@pytest.mark.parametrize("function", REFUSED)
def test_what_cannot_be_compiled_is_refused_when_the_class_is_made(function):
    what, instead = REFUSED[function]
    body = {"__annotations__": {"x": float}, "show": view("ePicture", compiled=True)(function)}
    with pytest.raises(NotCompilable) as error:
        type("Bear", (Agent,), body | {"x": 0.0, "__module__": __name__}, symbol="ABear")
    assert what in str(error.value)
    assert instead in str(error.value).splitlines()[-1]
    assert isinstance(EMPTY, Scene)
