"""Settings of the command line override those of a world file."""

import pytest

from minerva_bus.errors import WorldFileError
from minerva_bus.launch.reading import read_world_file
from minerva_bus.launch.typed import by_process, read_view, toml_value, typed_options
from minerva_bus.settings.overrides import Overrides
from minerva_bus.world.services import Generator

MODULE = """
from minerva_bus import *
PDot = Primitive("PDot")
vocabulary = Vocabulary.of(PDot)
class Rest(Generator):
    pass
"""
FILE = """
[world]
string = "PDot"
vocabulary = "resting:vocabulary"

[bus]
listen = "tcp/127.0.0.1:7447"
journal = "own"

[process.rest]
service = "resting:Rest"
"""


@pytest.fixture
def path(tmp_path):
    (tmp_path / "resting.py").write_text(MODULE)
    (tmp_path / "rest.toml").write_text(FILE)
    return tmp_path / "rest.toml"


def test_a_world_file_holds_as_it_is_written(path):
    file = read_world_file(path)
    assert (file.bus.listen, file.bus.journal) == ("tcp/127.0.0.1:7447", "own")
    assert (file.world.name, file.world.seed, file.rate) == ("rest", 0, 0.0)


def test_given_values_override_defaults(path):
    given = Overrides(name="other", seed=3, rate=5.0, journal="another", listen="tcp/127.0.0.1:0")
    file = read_world_file(path, given)
    assert (file.bus.listen, file.bus.journal) == ("tcp/127.0.0.1:0", "another")
    assert (file.world.name, file.world.seed, file.rate) == ("other", 3, 5.0)


def test_settings_are_sorted_by_process():
    given = ("a.x=1", "b.x=true", "a.y=two words", "a.x=2")
    assert by_process(given) == {"a": {"x": 2, "y": "two words"}, "b": {"x": True}}


@pytest.mark.parametrize("setting", ["a=1", "a.b", "a"])
def test_a_setting_names_a_process_and_a_key(setting):
    with pytest.raises(WorldFileError, match=r"expected PROCESS.KEY=VALUE"):
        by_process((setting,))


@pytest.mark.parametrize(("text", "view"), [
    ("svg", ("svg", "svg", {})),
    ("svg:every=5,path=a.svg", ("svg", "svg", {"every": 5, "path": "a.svg"})),
    ("mine:Screen", ("mine:Screen", "screen", {})),
    ("mine:Screen:said=true", ("mine:Screen", "screen", {"said": True})),
])  # fmt: skip
def test_a_view_is_a_service_with_options(text, view):
    assert read_view(text) == view


@pytest.mark.parametrize(("text", "value"), [
    ("1", 1), ("1.5", 1.5), ("true", True), ("[1, 2]", [1, 2]), ('"1"', "1"), ("a = b", "a = b"),
    ("", ""), ("1\nx = 2", 1),
])  # fmt: skip
def test_a_value_is_one_of_toml_or_a_text(text, value):
    assert toml_value(text) == value


class Eye(Generator):
    def __init__(self, source: str = "", fps: float = 1.0, names=None) -> None:
        pass


@pytest.mark.parametrize(("key", "text", "value"), [
    ("source", "0", "0"), ("source", '"0"', "0"), ("source", "true", "true"), ("source", "a", "a"),
    ("fps", "2", 2), ("names", "{ 0 = 'a' }", {"0": "a"}), ("other", "3", 3),
])  # fmt: skip
def test_text_options_stay_texts_even_if_numeric(key, text, value):
    assert typed_options(Eye, {key: text}) == {key: value}
