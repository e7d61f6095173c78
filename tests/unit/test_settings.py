"""Settings: declared once for file, command line, help and documents; overrides of a world file."""

import inspect
from dataclasses import fields

import pytest

from minerva_bus import Policy
from minerva_bus.cli.commands import worlds
from minerva_bus.cli.options import Settings, Takes, Views, grouped
from minerva_bus.errors import MisuseError, WorldFileError
from minerva_bus.launch.toml_tables import (
    Table,
    read_toml,
    read_view,
    settings_by_process,
    toml_value,
    typed_options,
)
from minerva_bus.launch.world_files import read_world_file
from minerva_bus.settings.kinds import (
    ADDRESS,
    BOOLEAN,
    TEXTS,
    TOPICS,
    choice,
    fits,
    number,
    settings_of,
    single,
    whole,
)
from minerva_bus.settings.world_settings import (
    OPTIONS,
    TABLES,
    Overrides,
    RecordSettings,
    WatchSettings,
    WorldSettings,
)
from minerva_bus.world.services import Generator
from tools.settings_tables import PAGES, filled, table_of


def top(text, **given):
    return Table(read_toml(text), "", text, "w.toml", Overrides(**given))


# --- layers ---


def test_the_command_line_is_over_the_file_and_the_file_over_the_defaults():
    text = "[world]\nseed = 3\nframes = 10\n"
    world = top(text, frames=20).read(WorldSettings)
    assert (world.seed, world.frames, world.rate) == (3, 20, 0.0)


def test_a_table_may_have_other_defaults():
    defaults = RecordSettings("a.mcap", durable=True)
    record = top("[world]\nflush = 1\n").read(RecordSettings, defaults)
    assert (record.path, record.flush, record.durable) == ("a.mcap", 1.0, True)


def test_settings_of_one_class_may_stand_in_several_tables():
    text = '[metrics]\nlisten = "a:1"\n[log]\nformat = "json"\n'
    assert top(text).read(WatchSettings) == WatchSettings("a:1", "json")
    assert top(text, metrics="b:2").read(WatchSettings).metrics == "b:2"


@pytest.mark.parametrize(
    ("value", "kept"), [("", "a.mcap"), (None, "a.mcap"), ("b.mcap", "b.mcap")]
)
def test_an_empty_text_leaves_a_setting_to_the_file(value, kept):
    assert top('[world]\nrecord = "a.mcap"\n', record=value).read(RecordSettings).path == kept


def test_an_empty_text_may_be_a_value():
    assert top('[world]\nuntil = "eEnd"\n', until="").read(WorldSettings).until == ""


def test_a_flag_that_is_false_is_a_value():
    assert not top("[world]\ndurable = true\n", durable=False).read(RecordSettings).durable


def test_layers_of_overrides():
    upper = Overrides({"a": "1"}, ("p.x=1",), seed=1)
    both = upper.over(Overrides({"a": "2", "b": "2"}, ("p.x=2",), seed=2, frames=3))
    assert both.options == {"a": "1", "b": "2"}
    assert both.settings == ("p.x=2", "p.x=1")  # The last one counts.
    assert both.values == {"seed": 1, "frames": 3}


# --- errors ---


def test_an_error_of_the_file_has_its_line_and_a_caret():
    with pytest.raises(WorldFileError) as caught:
        top("[world]\n  frames = -1\n", frames=5).read(WorldSettings)
    first, excerpt, caret = str(caught.value).split("\n")
    assert first == "w.toml:2:3: world.frames must be at least 0"
    assert excerpt[caret.index("^") :] == "frames = -1"


def test_a_program_in_place_of_a_world_file_is_refused_with_what_to_do(tmp_path):
    (path := tmp_path / "snails.py").write_text("import sys\n")
    with pytest.raises(WorldFileError, match=r"python snails\.py runs it, and World\.save in it"):
        read_world_file(path)


@pytest.mark.parametrize(
    ("given", "message"),
    [
        ({"frames": -1}, "--frames must be at least 0, not -1"),
        ({"rate": float("inf")}, "--rate must be a number from 0, not inf"),
        ({"seed": 1 << 63}, "--seed must be at most 9223372036854775807"),
    ],
)
def test_an_error_of_the_command_line_names_the_option(given, message):
    with pytest.raises(WorldFileError, match=message):
        top("[world]\n", **given).read(WorldSettings)


def test_an_error_found_later_names_the_place_of_the_value():
    with pytest.raises(WorldFileError, match=r"^--until has"):
        top("[world]\n", until="eEnd").wrong_setting(WorldSettings, "until", "has no agents")
    with pytest.raises(WorldFileError, match=r"^w.toml:2:1: world.until has"):
        top("[world]\nuntil = 'eEnd'").wrong_setting(WorldSettings, "until", "has no agents")


def test_an_unknown_setting_is_an_error():
    with pytest.raises(MisuseError, match="no setting 'frame'; did you mean 'frames'"):
        Overrides(frame=1)


@pytest.mark.parametrize(
    ("kind", "value", "converted"),
    [
        (whole(1, 5), 5, 5), (whole(1, 5), 0, None), (whole(1, 5), 6, None), (whole(), True, None),
        (number(), 2, 2.0), (number(), float("nan"), None), (number(0.5), 0.4, None),
        (BOOLEAN, 1, None), (TEXTS, "a", ("a",)), (TEXTS, ["a", 1], None), (TEXTS, 1, None),
        (choice("a", "b"), "b", "b"), (choice("a", "b"), "c", None), (single("x"), ["a"], "a"),
        (single("x"), ["a", "b"], None), (ADDRESS, "", ""), (ADDRESS, "h:1", "h:1"),
        (ADDRESS, "h", None), (TOPICS, True, ("*",)), (TOPICS, "all", ("*",)),
        (TOPICS, "a, b", ("a", "b")), (TOPICS, ["a"], ("a",)), (TOPICS, "a/b", None),
    ],
)  # fmt: skip
def test_kinds_convert_or_refuse(kind, value, converted):
    if converted is None:
        with pytest.raises(MisuseError, match=r"^must be "):
            kind.convert(value)
    else:
        assert kind.convert(value) == converted


@pytest.mark.parametrize(
    ("value", "python", "wanted"),
    [(1, float, True), (1.0, int, False), (True, int, False), ("a", str, True), ([], object, True)],
)
def test_values_fit_types(value, python, wanted):
    assert fits(value, python) == wanted


# --- one declaration ---


def test_names_of_options_and_keys_are_unique():
    declared = [setting for cls in TABLES for setting in settings_of(cls).values()]
    options = [setting.option for setting in declared if setting.option]
    keys = [(setting.table, setting.key) for setting in declared if setting.key]
    assert len(set(options)) == len(options) == len(OPTIONS)
    assert len(set(keys)) == len(keys)


@pytest.mark.parametrize("cls", TABLES)
def test_defaults_are_of_their_kind(cls):
    for setting in settings_of(cls).values():
        if setting.default is not None:
            assert setting.kind.convert(setting.default) == setting.default
        assert setting.help.endswith(".")


def test_every_field_of_a_table_is_a_setting():
    for cls in TABLES:
        assert {each.name for each in fields(cls)} == settings_of(cls).keys()


def test_run_takes_every_setting_that_has_an_option_and_few_parameters():
    options = inspect.signature(worlds.run).parameters
    assert OPTIONS.keys() <= options.keys()
    assert len(inspect.signature(inspect.unwrap(worlds.run)).parameters) <= 7


def test_groups_of_options_are_collected():
    seen = []

    @grouped
    def command(given: inspect.Parameter, file: str = "a") -> None:
        seen.append((given, file))

    command(given=1, file="b")
    takes = Takes("seed", "view", "connect")
    assert [each.annotation for each in takes.parameters()][1] == Views != Settings
    values = {"seed": 1, "view": ["svg"], "connect": ["tcp/a:1"], "file": "x"}
    given = takes.collect(values)
    assert (given.views, given.values) == (("svg",), {"seed": 1, "connect": ("tcp/a:1",)})
    assert (seen, values) == ([(1, "b")], {"file": "x"})


@pytest.mark.parametrize("page", PAGES)
def test_the_tables_of_the_documents_follow_from_the_declarations(page):
    text = page.read_text(encoding="utf-8")
    assert filled(text) == text, "run python -m tools.settings_tables"


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("{0}{0}{1}", "line 1: <!-- settings: Record --> lacks its end marker"),
        ("a\n{0}b\n", "line 2: <!-- settings: Record --> lacks its end marker"),
        ("a\n{1}{0}{1}", "line 2: <!-- end of settings --> lacks a start marker before it"),
    ],
)
def test_a_marker_without_its_counterpart_is_an_error(text, said):
    """The text up to the end of another block would be lost."""
    with pytest.raises(SystemExit) as error:
        filled(text.format("<!-- settings: Record -->\n", "<!-- end of settings -->\n"))
    assert str(error.value) == said


@pytest.mark.parametrize("lines", ["", "\n", "\n\n", "\nold\n\n"])
def test_an_empty_block_gets_its_table_and_no_other_text_is_lost(lines):
    begin, end = "<!-- settings: Record -->\n", "<!-- end of settings -->\n"
    table = f"{begin}\n{table_of((RecordSettings,))}\n\n{end}"
    assert filled(f"{begin}{lines}{end}between\n{table}") == f"{table}between\n{table}"


def test_a_row_has_key_type_default_option_and_meaning():
    rows = table_of((RecordSettings,))
    assert "| `flush` | seconds from 0 | 2 | `--flush` | Flush the record to disk at" in rows


def test_a_world_may_have_each_policy():
    policy = settings_of(WorldSettings)["policy"]
    assert policy.kind.schema["enum"] == [each.value for each in Policy]


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
    assert settings_by_process(given) == {"a": {"x": 2, "y": "two words"}, "b": {"x": True}}


@pytest.mark.parametrize("setting", ["a=1", "a.b", "a"])
def test_a_setting_names_a_process_and_a_key(setting):
    with pytest.raises(WorldFileError, match=r"expected PROCESS.KEY=VALUE"):
        settings_by_process((setting,))


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
