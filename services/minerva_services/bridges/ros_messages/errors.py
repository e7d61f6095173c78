"""Errors of single messages."""

from minerva_bus.errors import MinervaError


class GarbageError(MinervaError):
    """Bytes that are not a message of their type, or a message that is not a valid reading."""
