"""Any world as text, by the forms of its symbols: minerva attach any_world:Ascii"""

from minerva_bus import Device, Disc, Label, Raster, interpret
from minerva_bus.semantics.plane import PlaneGeometry, bounds, resolve

WIDTH = 76


class Paper(PlaneGeometry):
    def __init__(self, vocabulary, extent):
        super().__init__(vocabulary)
        self.signs, self.extent = {}, extent
        self.scale = WIDTH / max(extent.right - extent.left, 1.0)

    def put(self, at, text):
        x, y = at.x - self.extent.left, at.y - self.extent.bottom
        for place, sign in enumerate(text):
            cell = int(x * self.scale) + place, int(y * self.scale / 2)
            if sign != "*" or cell not in self.signs:
                self.signs[cell] = sign

    def shape(self, shape, figure):  # α; β and δ have moved self.pose
        values = figure.parameters
        if isinstance(shape, Disc):
            heading = ">^<v"[round(self.pose.angle / 90) % 4]
            self.put(self.pose, heading if shape.heading else "*")
        elif isinstance(shape, Label):
            self.put(self.pose, values[shape.text])
        elif isinstance(shape, Raster) and shape.height:
            x, y, cell = (
                resolve(expression, values) for expression in (shape.x, shape.y, shape.cell)
            )
            for row, column in zip(*(values[shape.cells] > 0).nonzero(), strict=True):
                self.put(self.pose.then(x + row * cell, y + column * cell, 0.0, 0.0), "#")


class Ascii(Device, draws=("ePicture",), when="each 10 frames"):
    def joined(self, world):
        self.vocabulary = world.vocabulary

    def show(self, view):
        extent = bounds(view.scene, self.vocabulary)
        if extent is None:
            return
        paper = Paper(self.vocabulary, extent)
        interpret(view.scene, paper)  # φ
        for y in range(max((y for _, y in paper.signs), default=0), -1, -1):
            print("".join(paper.signs.get((x, y), " ") for x in range(WIDTH)).rstrip())
