"""Groups of options that several services share."""

from dataclasses import dataclass
from inspect import Parameter, signature

import pytest

from minerva_bus.errors import WorldFileError
from minerva_bus.launch.specs import bind, find_service
from minerva_services.options import grouped, takes_options


@dataclass(frozen=True)
class Position:
    where: str
    level: int = 0
    hidden: float = 1.0


@dataclass(frozen=True)
class Size:
    width: float = 2.0


class Board:
    @takes_options(Position, Size, without=("hidden",))
    def __init__(self, name: str, width: int = 3, **further):
        self.name, self.width = name, width
        self.place, _ = grouped(further, Position, Size)


def test_the_signature_lists_own_options_then_those_of_the_groups():
    parameters = signature(Board.__init__).parameters
    assert list(parameters) == ["self", "name", "width", "where", "level"]
    assert parameters["where"].default is Parameter.empty
    assert (parameters["level"].default, parameters["level"].annotation) == (0, int)


def test_groups_are_created_from_their_own_options():
    assert grouped({"where": "hall", "width": 1.0}, Position, Size) == (Position("hall"), Size(1.0))
    assert Board("b", where="hall", level=2).place == Position("hall", 2)


def test_an_option_of_no_group_is_an_error():
    with pytest.raises(TypeError, match="unknown options: wide"):
        Board("b", where="hall", wide=1)


@pytest.mark.parametrize(
    ("service", "options", "problem"),
    [
        ("sprites", {"widht": 3}, "no option 'widht'; did you mean 'width'"),
        ("opengl", {"fps": "many"}, "fps must be a number"),
        ("mqtt", {"broker": "b", "user": 3}, "user must be a"),
        ("ros2_robot", {"router": "tcp/h:1", "near": "far"}, "near must be a number"),
        ("markers", {"size": 0.2}, "needs the option 'dictionary'"),
    ],
)
def test_world_files_are_checked_against_the_groups(service, options, problem):
    with pytest.raises(WorldFileError, match=problem):
        bind(find_service(service), options, "member")
