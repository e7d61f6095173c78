"""The room and the thermostat of heating.py as mosaik simulators (docs/migration/5-mosaik.md)."""

import mosaik
import mosaik_api_v3

ROWS = []


class Model(mosaik_api_v3.Simulator):
    """One entity, which is stepped once for each unit of time."""

    def __init__(self):
        super().__init__(self.META)

    def create(self, number, model):
        return [{"eid": model, "type": model}]

    def step(self, time, inputs, max_advance):
        self.update(
            **{name: next(iter(values.values())) for name, values in inputs["Entity"].items()}
        )
        return time + 1

    def get_data(self, outputs):
        return {"Entity": {name: getattr(self, name) for name in outputs["Entity"]}}


def meta(*attributes):
    model = {"public": True, "params": [], "attrs": [*attributes]}
    return {"api_version": "3.0", "type": "time-based", "models": {"Entity": model}}


class Room(Model):
    META = meta("celsius", "watts")
    celsius = 18.0

    def update(self, watts):
        self.celsius += watts / 2000 - 0.02 * (self.celsius - 5)


class Thermostat(Model):
    META = meta("celsius", "watts")
    watts = 0.0

    def update(self, celsius):
        if not 20 <= celsius <= 21:
            self.watts = 1000.0 if celsius < 20 else 0.0


class Table(Model):
    META = meta("celsius")

    def update(self, celsius):
        ROWS.append(celsius)


def temperatures(steps):
    """The temperature after each step."""
    names = ("Room", "Thermostat", "Table")
    world = mosaik.World({name: {"python": f"{__name__}:{name}"} for name in names})
    room, thermostat, table = (world.start(name).Entity() for name in names)
    world.connect(room, thermostat, "celsius", time_shifted=True, initial_data={"celsius": 20.0})
    world.connect(thermostat, room, "watts", time_shifted=True, initial_data={"watts": 0.0})
    world.connect(room, table, "celsius")
    world.run(until=steps)
    return ROWS


if __name__ == "__main__":
    print(temperatures(100))
