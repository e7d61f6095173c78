"""What can be wrong with a record."""

from minerva_bus.errors import MinervaError


class RecordError(MinervaError):
    """A record cannot be written, or a file is no record, or is damaged."""
