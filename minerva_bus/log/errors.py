"""Errors of records, and the check for the optional library that reads and writes them."""

from minerva_bus.errors import MinervaError, MisuseError
from minerva_bus.wording import install


class RecordError(MinervaError):
    """A record cannot be written, or a file is damaged or not a record."""


def check_installed() -> None:
    """Raise MisuseError if mcap is not installed."""
    try:
        import mcap.writer  # noqa: F401  # pyright: ignore[reportUnusedImport]
    except ImportError:
        raise MisuseError(f"records need mcap: {install('record')}") from None
