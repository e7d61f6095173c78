# The part of HELICS that minerva_cosimulation uses.
from typing import Any

class HelicsException(Exception): ...

class HelicsPublication:
    name: str
    def publish(self, value: Any) -> None: ...

class HelicsInput:
    name: str
    target: str
    integer: int
    boolean: bool
    double: float
    string: str
    vector: list[float]
    def is_updated(self) -> bool: ...

class HelicsMessage:
    time: float
    original_source: str
    original_destination: str
    raw_data: bytes

class HelicsEndpoint:
    name: str
    default_destination: str
    n_pending_messages: int
    def get_message(self) -> HelicsMessage: ...
    def send_data(self, data: bytes, destination: str) -> None: ...

class HelicsCombinationFederate:
    name: str
    n_endpoints: int
    n_publications: int
    n_inputs: int
    def get_publication_by_index(self, index: int) -> HelicsPublication: ...
    def get_subscription_by_index(self, index: int) -> HelicsInput: ...
    def get_endpoint_by_index(self, index: int) -> HelicsEndpoint: ...
    def enter_executing_mode(self) -> int: ...
    def request_time(self, time: float) -> float: ...
    def disconnect(self) -> None: ...

HELICS_FLAG_UNINTERRUPTIBLE: int

def helicsCreateCombinationFederateFromConfig(config: str) -> HelicsCombinationFederate: ...
def helicsFederateSetFlagOption(fed: HelicsCombinationFederate, flag: int, value: bool) -> None: ...
def helicsEndpointGetTag(endpoint: HelicsEndpoint, tagname: str) -> str: ...
def helicsAbort(code: int, message: str) -> None: ...
