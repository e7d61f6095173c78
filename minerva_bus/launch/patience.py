"""How long a frame waits for members, in [bus] or for one process."""

from __future__ import annotations

from minerva_bus.launch.table import Table
from minerva_bus.runtime.waiting import Patience
from minerva_bus.settings.declaring import settings_of
from minerva_bus.settings.tables import PatienceSettings

KEYS = tuple(settings_of(PatienceSettings))


def read_patience(table: Table, defaults: PatienceSettings | None = None) -> PatienceSettings:
    """The settings of a table; `defaults` are those of [bus]. Raises WorldFileError."""
    settings = table.read(PatienceSettings, defaults)
    if settings.soft > settings.hard:
        table.wrong("soft", f"must not be over hard, {settings.hard:g}")
    return settings


def patience(settings: PatienceSettings) -> Patience:
    """The patience with a member that these settings describe."""
    return Patience(settings.soft, settings.hard, settings.late)
