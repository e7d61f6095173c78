"""Minerva Bus: virtual worlds as strings of a small language, run by many processes.

The names a user needs; see README.md.
"""

from minerva_bus.errors import MinervaError
from minerva_bus.grammar.batch import Events
from minerva_bus.grammar.events import Event
from minerva_bus.grammar.forms import Disc, Label, Line, Motion, Raster
from minerva_bus.grammar.ids import Ids
from minerva_bus.grammar.parser import parse
from minerva_bus.grammar.scene import EMPTY, Scene
from minerva_bus.grammar.symbols import AgentKind, Default, EventType, Primitive, Transformation
from minerva_bus.grammar.types import Cells, Degrees, Metres, MetresPerSecond, Reals, Seconds
from minerva_bus.grammar.vocabulary import Vocabulary
from minerva_bus.semantics.geometry import Geometry, interpret
from minerva_bus.world.agent import Agent, on, view
from minerva_bus.world.evolution import Policy, evolve
from minerva_bus.world.moment import Frame, Moment
from minerva_bus.world.services import Device, Generator, Tick, View, WorldInfo
from minerva_bus.world.views import visualize

__version__ = "0.2.0"

__all__ = [
    "EMPTY",
    "Agent",
    "AgentKind",
    "Cells",
    "Default",
    "Degrees",
    "Device",
    "Disc",
    "Event",
    "EventType",
    "Events",
    "Frame",
    "Generator",
    "Geometry",
    "Ids",
    "Label",
    "Line",
    "Metres",
    "MetresPerSecond",
    "MinervaError",
    "Moment",
    "Motion",
    "Policy",
    "Primitive",
    "Raster",
    "Reals",
    "Scene",
    "Seconds",
    "Tick",
    "Transformation",
    "View",
    "Vocabulary",
    "WorldInfo",
    "evolve",
    "interpret",
    "on",
    "parse",
    "view",
    "visualize",
]
