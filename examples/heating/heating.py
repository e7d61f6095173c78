"""A room and its thermostat: two agents that exchange events (docs/migration/5-mosaik.md)."""

from minerva_bus import Agent, EventType, World, each, on, run

eStep = EventType("eStep")
eHeat = EventType("eHeat", watts=float)
eTemperature = EventType("eTemperature", celsius=float)


class Room(Agent, symbol="ARoom"):
    celsius: float = 18.0
    watts: float = 0.0

    @on("eHeat")
    def heat(self, heat, moment):
        self.watts = heat.watts

    @on("eStep")
    def cool(self, step, moment):
        self.celsius += self.watts / 2000 - 0.02 * (self.celsius - 5)
        moment.emit(eTemperature(self.celsius))


class Thermostat(Agent, symbol="AThermostat"):
    watts: float = 0.0

    @on("eTemperature")
    def switch(self, temperature, moment):
        if not 20 <= temperature.celsius <= 21:
            self.watts = 1000.0 if temperature.celsius < 20 else 0.0
        moment.emit(eHeat(self.watts))


world = World(
    "ARoom#room · AThermostat#thermostat",
    agents=[Room, Thermostat],
    services=[each(eStep)],
    name="heating",
)

if __name__ == "__main__":
    print(run(world, frames=100, collect={"celsius": Room.celsius}).table("ARoom"))
