"""ROS 2 robots over Zenoh, without ROS: sensors, motors, and RViz."""

from minerva_services.bridges.ros2.body import Ros2Robot
from minerva_services.bridges.ros2.sensors import Ros2
from minerva_services.bridges.ros2.view import Ros2View

__all__ = ["Ros2", "Ros2Robot", "Ros2View"]
