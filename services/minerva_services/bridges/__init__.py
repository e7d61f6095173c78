"""Bridges to other systems: ROS 2, MQTT and XMPP, and what bridges share."""
