"""Messages of ROS as readings: the same in ROS 1 and ROS 2, from a bag and from a network."""

from minerva_services.bridges.ros_messages.errors import GarbageError
from minerva_services.bridges.ros_messages.frames import Frames, Mounting

__all__ = ["Frames", "GarbageError", "Mounting"]
