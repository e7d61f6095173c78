"""Class attributes of agents: a list that methods change is shared, one that they read is not."""

import pytest

from minerva_bus import check

CODE = """
from minerva_bus import Agent, EventType, Vocabulary, on

eGo = EventType("eGo")


class Base(Agent):
    names = {"a": 1}
    PLACES = ["inn", "bar"]


class Car(Base, symbol="ACar"):
    seen = []
    places = ("inn", "bar")
    n: int = 0

    @on("eGo")
    def go(self, event, moment):
        CHANGE


vocabulary = Vocabulary.of(eGo, Car)
"""
WORLD = """
[world]
string = "ACar#car"
vocabulary = "MODULE:vocabulary"
frames = 3

[process.cars]
agents = "MODULE:Car"
"""


def warnings(folder, change, module):
    (folder / f"{module}.py").write_text(CODE.replace("CHANGE", change))
    (folder / "world.toml").write_text(WORLD.replace("MODULE", module))
    return check(folder / "world.toml").warnings


@pytest.mark.parametrize(
    ("change", "name"),
    [
        ("self.seen.append(self.n)", "seen, a list"),
        ("self.seen[:] = [1]", "seen, a list"),
        ("del Car.seen[0]", "seen, a list"),
        ("Car.seen += [1]", "seen, a list"),
        ("self.names['b'] = self.n", "names, a dict"),
        ("self.PLACES.sort()", "PLACES, a list"),
    ],
)
def test_an_object_that_all_agents_change_is_named(tmp_path, change, name):
    module = f"shared_{abs(hash(change))}"
    (text,) = warnings(tmp_path, change, module)
    assert text.startswith(f"{tmp_path / module}.py:19: Car changes {name} that all agents share")
    assert "declare an attribute of the agent" in text


@pytest.mark.parametrize(
    "use",
    [
        "self.n += len(self.seen)",
        "self.n = self.names['a']",
        "seen = []; seen.append(self.PLACES[0])",
        "self.n = self.PLACES.index('inn')",
        "for name in self.PLACES: self.n += name in self.names",
    ],
)
def test_constants_that_methods_read_need_no_warning(tmp_path, use):
    assert warnings(tmp_path, use, f"constant_{abs(hash(use))}") == []
