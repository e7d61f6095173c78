"""Bags of ROS 1 and ROS 2, played into a world without ROS."""

from minerva_services.rosbag.bag import Bag, open_bag
from minerva_services.rosbag.service import Rosbag

__all__ = ["Bag", "Rosbag", "open_bag"]
