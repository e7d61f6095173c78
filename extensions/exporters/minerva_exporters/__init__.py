"""Records in the formats of other tools: bags of ROS 2, Rerun, LeRobot."""
