"""A house: each room has a sensor, a heater, and a thermostat that connects them by events."""

from minerva_bus import (
    Agent,
    Context,
    Disc,
    Event,
    EventType,
    Label,
    Line,
    Metres,
    Motion,
    Primitive,
    Scene,
    Transformation,
    Vocabulary,
    on,
    view,
)

HYSTERESIS = 0.5

PHeater = Primitive("PHeater", on=bool)
PWarm = Primitive(
    "PWarm", Disc("radius", "#d4622a", meaning="room with its heater on"), radius=Metres
)
PCool = Primitive(
    "PCool", Disc("radius", "#5b8db8", meaning="room with its heater off"), radius=Metres
)
PWalls = Primitive(
    "PWalls", Line("xs", "ys", "#6b6259", 0.12), xs=tuple[float, ...], ys=tuple[float, ...]
)
PSign = Primitive("PSign", Label("text", meaning="temperature and target of a room"), text=str)
TRoom = Transformation("TRoom", room=str)
TPlace = Transformation("TPlace", Motion("x", "y"), x=Metres, y=Metres)

eTemperature = EventType("eTemperature", celsius=float)
eTarget = EventType("eTarget", celsius=float)
eSwitch = EventType("eSwitch", visual=True)
ePicture = EventType("ePicture", visual=True)

WALLS = PWalls(xs=(-3.0, 3.0, 3.0, -3.0, -3.0), ys=(-2.0, -2.0, 2.0, 2.0, -2.0))


class Thermostat(Agent, symbol="AThermostat"):
    """Controls the heater of the room that has this agent's id."""

    x: Metres = 0.0
    celsius: float = 20.0
    target: float = 20.0
    heats: bool = False

    @on("eTemperature")
    def feel(self, air: Event, moment: Context) -> None:
        self.celsius = air.celsius
        if abs(self.celsius - self.target) > HYSTERESIS:
            self.heats = self.celsius < self.target

    @on("eTarget")
    def obey(self, wish: Event, moment: Context) -> None:
        self.target = wish.celsius
        self.heats = self.celsius < self.target

    @view("eSwitch")
    def switch(self, event: Event) -> Scene:
        return TRoom(self.id)(PHeater(self.heats))

    @view("ePicture")
    def picture(self, event: Event) -> Scene:
        heater = PWarm(0.8) if self.heats else PCool(0.8)
        sign = PSign(f"{self.id}: {self.celsius:g} °C, {self.target:g} wanted")
        return TPlace(self.x, 0.0)(WALLS + heater + TPlace(-2.6, -1.5)(sign))


vocabulary = Vocabulary.of(
    *(PHeater, PWarm, PCool, PWalls, PSign, TRoom, TPlace),
    *(eTemperature, eTarget, eSwitch, ePicture, Thermostat),
)
