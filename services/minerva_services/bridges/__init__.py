"""Bridges to other systems: ROS 2, MQTT and XMPP, and code that bridges share."""
