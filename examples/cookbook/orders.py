"""People's orders: a program tells one robot where to drive, and the other one stays."""

import numpy as np

from minerva_bus import Disc, EventType, World, each, on, portable
from minerva_study import Placed

eDrive = EventType("eDrive", x=float, y=float)


class Robot(Placed, form=Disc(0.3, "#d55e00", heading=True)):
    goal_x: float
    goal_y: float
    turn: float = 90.0  # degrees

    @on("eDrive")
    def obey(self, order, moment):
        self.goal_x, self.goal_y = order.x, order.y
        self.turn = np.degrees(portable.atan2(order.y - self.y, order.x - self.x))

    @on("eStep")
    def drive(self, step, moment):
        self.x += 0.2 * (self.goal_x - self.x)
        self.y += 0.2 * (self.goal_y - self.y)


anna = Robot("anna", x=0.0, y=0.0, goal_x=0.0, goal_y=0.0)
bob = Robot("bob", x=5.0, y=0.0, goal_x=5.0, goal_y=0.0)
robots = anna.string + bob.string
world = World(robots, services=[each("eStep")], people=[eDrive], name="robots")
with world.start() as live:
    live.publish(eDrive(x=3.0, y=4.0, receivers=["anna"]))
    live.step(30)
    print(live.agents(Robot))
    live.picture().save("orders.svg")
