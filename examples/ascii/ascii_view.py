"""The robot's world as text: minerva attach ascii_view:Ascii"""

from contextlib import contextmanager

from minerva_bus import Device, Geometry, interpret


class Paper(Geometry):
    def __init__(self):
        self.signs, self.at = {}, (0.0, 0.0, 0.0)

    def put(self, sign, x, y, *_):
        self.signs[int(x * 4), int(y * 2)] = sign

    def PMap(self, cells, resolution, x, y, angle):  # α
        for row, column in zip(*(cells > 0).nonzero(), strict=True):
            self.put("#", x + row * resolution, y + column * resolution)

    def PMarker(self, name):
        for place, letter in enumerate(name):
            self.put(letter, self.at[0] + place / 4, self.at[1])

    def PGoal(self, radius):
        self.put("*", *self.at)

    def PRobot(self, name, radius):
        self.put(">^<v"[round(self.at[2] / 90) % 4], *self.at)

    @contextmanager
    def TPlace(self, x, y, angle):
        before, self.at = self.at, (x, y, angle)  # β, at "("
        yield
        self.at = before  # δ, at ")"


class Ascii(Device, draws=("ePicture",), when="each 10 frames"):
    def show(self, view):
        paper = Paper()
        interpret(view.scene, paper)  # φ
        for y in range(23, -1, -1):
            print("".join(paper.signs.get((x, y), " ") for x in range(72)).rstrip())
