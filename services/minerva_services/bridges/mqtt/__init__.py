"""MQTT, both ways: what a broker's clients publish as events, and views as messages for them."""

from minerva_services.bridges.mqtt.service import Mqtt

__all__ = ["Mqtt"]
