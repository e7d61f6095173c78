"""GIS points: cities of a GeoJSON file, in metres; a fashion spreads to the next within 950 km."""

import json
import math
from pathlib import Path

from minerva_bus import EMPTY, Disc, EventType, Label, Primitive, World, on, run, service
from minerva_study import Placed
from minerva_study.placed import TAt

eNear = EventType("eNear", sum_wears=float)
PName = Primitive("PName", Label("name"), name=str)


class City(Placed, form=Disc(60e3, "groups(wears, 0, 2)", meaning="as before, in fashion")):
    wears: bool = False

    @on("eNear", population=True)
    def look(self, near, moment):
        self.wears |= near.sum_wears > 0


scene = EMPTY
for city in json.loads(Path(__file__).with_name("cities.geojson").read_text())["features"]:
    name, (east, north) = city["properties"]["name"], city["geometry"]["coordinates"]
    x, y = 111.3e3 * math.cos(math.radians(47)) * east, 111.3e3 * north
    scene += City(name, x=x, y=y, wears=name == "Paris").string + TAt(x, y + 60e3)(PName(name))
near = service("neighbours", draws="ePicture", summary=True, radius=950e3)
run(World(scene, services=[near], name="fashion"), frames=5).picture().save("gis.svg")
