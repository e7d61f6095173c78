"""People's orders: a program or a person tells one robot where to drive."""

from minerva_bus import Disc, EventType, World, each, on
from minerva_study import Placed

eDrive = EventType("eDrive", x=float, y=float)


class Robot(Placed, form=Disc(0.3, "#d55e00")):
    goal_x: float = 0.0
    goal_y: float = 0.0

    @on("eDrive")
    def obey(self, order, moment):
        self.goal_x, self.goal_y = order.x, order.y

    @on("eStep")
    def drive(self, step, moment):
        self.x += 0.2 * (self.goal_x - self.x)
        self.y += 0.2 * (self.goal_y - self.y)


robots = Robot("anna", x=0.0, y=0.0).string + Robot("bob", x=5.0, y=0.0).string
world = World(robots, services=[each("eStep")], people=[eDrive], name="robots")
with world.start() as live:
    live.publish(eDrive(x=3.0, y=4.0, receivers=["anna"]))
    live.step(30)
    print(live.agents(Robot))
    live.picture().save("orders.svg")
