"""GIS points: cities of a GeoJSON file, in kilometres; a fashion spreads to those within 900 km."""

import json
import math
from pathlib import Path

from minerva_bus import EMPTY, Disc, EventType, Label, Primitive, World, on, run, service
from minerva_study import Placed
from minerva_study.placed import TAt

eNear = EventType("eNear", sum_wears=float)
PName = Primitive("PName", Label("name"), name=str)


class City(Placed, form=Disc(60.0, "groups(wears, 0, 2)", meaning="as before, in fashion")):
    wears: bool = False

    @on("eNear", population=True)
    def look(self, near, moment):
        self.wears |= near.sum_wears > 0


scene = EMPTY
for city in json.loads(Path(__file__).with_name("cities.geojson").read_text())["features"]:
    name, (east, north) = city["properties"]["name"], city["geometry"]["coordinates"]
    x, y = 111.3 * math.cos(math.radians(47)) * east, 111.3 * north
    scene += City(name, x=x, y=y, wears=name == "Paris").string + TAt(x, y)(PName(name))
near = service("neighbours", draws="ePicture", summary=True, radius=900.0)
run(World(scene, services=[near], name="fashion"), frames=2).picture().save("gis.svg")
