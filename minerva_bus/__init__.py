"""Minerva Bus: virtual worlds as strings of a small language, run by many processes.

The names that users need; see README.md.
"""

from minerva_bus.public_names import imported_at_first_use
from minerva_bus.uncaught import install as _report_uncaught_errors

TYPE_CHECKING = False  # Instead of typing.TYPE_CHECKING, because importing typing takes time.
if TYPE_CHECKING:
    from minerva_bus.api.checking import check
    from minerva_bus.api.live import Live, connect
    from minerva_bus.api.python_tables import each, service
    from minerva_bus.api.running import Interrupted, Run, record, resume, run
    from minerva_bus.api.world import World
    from minerva_bus.errors import MinervaError
    from minerva_bus.grammar.appearance import Disc, Label, Line, Motion, Raster
    from minerva_bus.grammar.events import Event, Events
    from minerva_bus.grammar.fields import Default
    from minerva_bus.grammar.ids import Ids
    from minerva_bus.grammar.parser import parse
    from minerva_bus.grammar.scene import EMPTY, Scene
    from minerva_bus.grammar.types import (
        Cells,
        Degrees,
        Metres,
        MetresPerSecond,
        Of,
        Range,
        Reals,
        Seconds,
    )
    from minerva_bus.grammar.vocabulary import (
        AgentKind,
        EventType,
        Primitive,
        Transformation,
        Vocabulary,
    )
    from minerva_bus.semantics.geometry import Geometry, interpret
    from minerva_bus.world.agent import Agent
    from minerva_bus.world.class_declaration import on, view
    from minerva_bus.world.context import BatchContext, Context, Frame
    from minerva_bus.world.evolution import Policy, evolve
    from minerva_bus.world.expressions import count, data
    from minerva_bus.world.population import EventBatch
    from minerva_bus.world.services import Device, Generator, Tick, View, WorldInfo
    from minerva_bus.world.visualization import visualize


__version__ = "0.7.0"

_HOMES = {
    "api.live": "Live connect",
    "api.checking": "check",
    "api.running": "Interrupted Run record resume run",
    "api.python_tables": "each service",
    "api.world": "World",
    "errors": "MinervaError",
    "grammar.events": "Event Events",
    "grammar.fields": "Default",
    "grammar.appearance": "Disc Label Line Motion Raster",
    "grammar.ids": "Ids",
    "grammar.parser": "parse",
    "grammar.scene": "EMPTY Scene",
    "grammar.types": "Cells Degrees Metres MetresPerSecond Of Range Reals Seconds",
    "grammar.vocabulary": "AgentKind EventType Primitive Transformation Vocabulary",
    "semantics.geometry": "Geometry interpret",
    "world.agent": "Agent",
    "world.evolution": "Policy evolve",
    "world.context": "BatchContext Context Frame",
    "world.population": "EventBatch",
    "world.expressions": "count data",
    "world.class_declaration": "on view",
    "world.services": "Device Generator Tick View WorldInfo",
    "world.visualization": "visualize",
}

_report_uncaught_errors()


__getattr__ = imported_at_first_use(__name__, _HOMES)


def __dir__() -> list[str]:
    return sorted({*globals(), *__all__})


__all__ = [
    "EMPTY", "Agent", "AgentKind", "BatchContext", "Cells", "Context", "Default", "Degrees",
    "Device", "Disc", "Event", "EventBatch", "EventType", "Events", "Frame", "Generator",
    "Geometry", "Ids", "Interrupted", "Label", "Line", "Live", "Metres", "MetresPerSecond",
    "MinervaError", "Motion", "Of", "Policy", "Primitive", "Range", "Raster", "Reals", "Run",
    "Scene", "Seconds", "Tick", "Transformation", "View", "Vocabulary", "World", "WorldInfo",
    "check", "connect", "count", "data", "each", "evolve", "interpret", "on", "parse", "record",
    "resume", "run", "service", "view", "visualize",
]  # fmt: skip
