"""Errors of records, and the check for the optional library that reads and writes them."""

from minerva_bus.errors import MinervaError, MisuseError


class RecordError(MinervaError):
    """A record cannot be written, or a file is damaged or not a record."""


def check_installed() -> None:
    """Raise MisuseError if mcap is not installed."""
    try:
        import mcap.writer  # noqa: F401  # pyright: ignore[reportUnusedImport]
    except ImportError:
        raise MisuseError("records need mcap: pip install 'minerva-bus[record]'") from None
