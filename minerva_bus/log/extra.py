"""Whether the library that writes and reads MCAP files is there."""

from minerva_bus.errors import MisuseError


def check_installed() -> None:
    """Raises MisuseError where the extra is not installed."""
    try:
        import mcap.writer  # noqa: F401  # pyright: ignore[reportUnusedImport]
    except ImportError:
        raise MisuseError("records need mcap: pip install 'minerva-bus[record]'") from None
