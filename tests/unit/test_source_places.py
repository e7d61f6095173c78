"""The line of user code that an error or a stack is reported at."""

from dataclasses import dataclass, field
from pathlib import Path

from minerva_bus.source import SourceLine, innermost, place_of


@dataclass(frozen=True)
class Box:
    size: float
    content: object = field(default=None, kw_only=True)


def shrinks(box):
    box.size = 0.5


def test_a_generated_method_is_not_the_place_of_an_error():
    try:
        shrinks(Box(1.0))
    except AttributeError as error:
        place = place_of(error)
    assert (Path(place.file).name, place.function) == ("test_source_places.py", "shrinks")
    assert place.shown[0] == "box.size = 0.5"


def test_generated_code_is_not_the_place_of_a_stack():
    compiler = SourceLine("<string>", 1, "<module>")
    caller = SourceLine(__file__, 20, "shrinks")
    assert innermost([compiler, caller]).function == "shrinks"
    assert innermost([compiler]).file == "<string>"
