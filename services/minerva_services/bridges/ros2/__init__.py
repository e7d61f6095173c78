"""ROS 2 robots over Zenoh, without ROS: sensors, motors, services, navigation, and RViz."""

from minerva_bus.public_names import imported_at_first_use

TYPE_CHECKING = False
if TYPE_CHECKING:
    from minerva_services.bridges.ros2.body import Ros2Robot
    from minerva_services.bridges.ros2.calls import Ros2Calls
    from minerva_services.bridges.ros2.navigation import Ros2Navigation
    from minerva_services.bridges.ros2.sensors import Ros2
    from minerva_services.bridges.ros2.view import Ros2View

_HOMES = {
    "body": "Ros2Robot", "calls": "Ros2Calls", "navigation": "Ros2Navigation",
    "sensors": "Ros2", "view": "Ros2View",
}  # fmt: skip

__getattr__ = imported_at_first_use(__name__, _HOMES)

__all__ = ["Ros2", "Ros2Calls", "Ros2Navigation", "Ros2Robot", "Ros2View"]
