"""Bags of ROS 1 and ROS 2, played into a world without ROS."""

from minerva_services.bridges.rosbag.bag import Bag, open_bag
from minerva_services.bridges.rosbag.service import Rosbag

__all__ = ["Bag", "Rosbag", "open_bag"]
