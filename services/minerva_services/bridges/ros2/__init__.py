"""ROS 2 robots over Zenoh, without ROS: sensors, motors, services, navigation, and RViz."""

from minerva_services.bridges.ros2.body import Ros2Robot
from minerva_services.bridges.ros2.calls import Ros2Calls
from minerva_services.bridges.ros2.navigation import Ros2Navigation
from minerva_services.bridges.ros2.sensors import Ros2
from minerva_services.bridges.ros2.view import Ros2View

__all__ = ["Ros2", "Ros2Calls", "Ros2Navigation", "Ros2Robot", "Ros2View"]
