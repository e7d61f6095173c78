"""MQTT in both directions: messages become events, and views become messages."""

from minerva_services.bridges.mqtt.service import Mqtt

__all__ = ["Mqtt"]
