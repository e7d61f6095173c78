"""The thermostat of heating.py as a HELICS federate (extensions/cosimulation/cosimulation.md)."""

import json

import helics

CONFIG = {
    "name": "thermostat",
    "core_type": "inproc",
    "core_name": "thermostat",
    "broker": "heating",
    "period": 1.0,
    "publications": [{"key": "watts", "type": "double"}],
    "inputs": [{"key": "celsius", "type": "double", "targets": ["house/room.celsius"]}],
}


def thermostat(until, **settings):
    """Switch the heating until this time; returns the temperatures that the house has published."""
    federate = helics.helicsCreateValueFederateFromConfig(json.dumps({**CONFIG, **settings}))
    (watts,) = federate.publications.values()
    (celsius,) = federate.subscriptions.values()
    federate.enter_executing_mode()
    temperatures = []
    power = 0.0
    for time in range(1, until + 1):
        federate.request_time(time)
        temperatures.append(celsius.double)
        # The temperature at time 0 is that of a room that has not been simulated yet.
        if time > 1 and not 20 <= celsius.double <= 21:
            power = 1000.0 if celsius.double < 20 else 0.0
        watts.publish(power)
    federate.disconnect()
    return temperatures
