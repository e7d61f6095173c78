"""Agents of the plane with a picture, for models of few lines.

    class Tree(Placed, form=Disc("size", "greens(age, 0, 80)")):
        size: float
        age: int = 0

        @on("eStep", population=True)
        def grow(self, step, moment): ...

A `Placed` has the attributes `x` and `y` in metres. Its view for `ePicture` moves the form there
(`TAt`), turned by the attribute `turn` in degrees if the class has it. The primitive, `PTree`, has
the id as `who`, and all attributes that are numbers or bools, so the service `neighbours` can read
the same view: `service("neighbours", draws="ePicture")`. A class with a view of its own for
`ePicture` has that instead. The event types `eStep` and `ePicture` need no declaration.
"""

from __future__ import annotations

import sys
from collections.abc import Callable
from typing import Any, ClassVar, Final

from minerva_bus import Agent, Disc, EventType, Metres, Motion, Primitive, Scene, Transformation
from minerva_bus.grammar.appearance import Raster, Shape
from minerva_bus.grammar.fields import Default
from minerva_bus.grammar.types import Degrees
from minerva_bus.world.class_declaration import state_of, view
from minerva_services.geometry.colors import check_color

eStep = EventType("eStep")  # noqa: N816
ePicture = EventType("ePicture", visual=True)  # noqa: N816
TAt = Transformation(
    "TAt", Motion("x", "y", "turn"), x=Metres, y=Metres, turn=Default(Degrees, 0.0)
)

_POSE: Final = ("x", "y", "turn")
_SHOWN: Final = ("real", "int", "bool")


class Placed(Agent):
    """An agent at a place of the plane, which has a picture; see the module.

    The arguments are those of a subclass.

    Args:
        symbol: of the agents; "": A and the name of the class, such as "ATree".
        form: of their pictures; measures and colours may name attributes. A subclass without one
            has that of its base.

    """

    x: Metres
    y: Metres

    form: ClassVar[Shape] = Disc(0.3, "#0072b2")

    def __init_subclass__(cls, symbol: str = "", form: Shape | None = None, **kwargs: Any) -> None:
        if form is not None:
            if not isinstance(form, Raster):
                check_color(form.color)
            cls.form = form
        symbol = symbol or f"A{cls.__name__}"
        if "picture" not in vars(cls):
            cls.picture = _picture_of(cls, symbol)
        super().__init_subclass__(symbol=symbol, **kwargs)


def _picture_of(cls: type[Placed], symbol: str) -> Callable[..., Scene]:
    """The view of a class, which shows its attributes at its place."""
    fields = state_of(cls, Agent)
    shown = {field.name: field.type for field in fields.all if field.type.kind in _SHOWN}
    pose = [name for name in _POSE if name in shown]
    names = [name for name in shown if name not in _POSE]
    primitive = Primitive(
        f"P{symbol[1:]}", cls.form, who=str, **{name: shown[name] for name in names}
    )
    # Other processes find a symbol as a variable of its module.
    vars(sys.modules[cls.__module__]).setdefault(primitive.name, primitive)

    def picture(self: Any, event: object) -> Scene:
        figure = primitive(self.id, *[getattr(self, name) for name in names])
        return TAt(*[getattr(self, name) for name in pose])(figure)

    picture.__qualname__ = f"{cls.__qualname__}.picture"
    return view("ePicture", population=True)(picture)
