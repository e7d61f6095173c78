"""What can be wrong with one message."""

from minerva_bus.errors import MinervaError


class GarbageError(MinervaError):
    """Bytes that are no message of their type, or a message that is no reading."""
