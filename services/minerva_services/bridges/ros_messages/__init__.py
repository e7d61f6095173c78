"""Conversion of ROS messages to readings and back, shared by ROS 1 and 2, bags and networks."""

from minerva_services.bridges.ros_messages.frames import Frames, GarbageError, SensorMount

__all__ = ["Frames", "GarbageError", "SensorMount"]
