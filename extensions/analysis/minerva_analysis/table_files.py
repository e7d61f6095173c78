"""Files of tables that appear when they are complete."""

from __future__ import annotations

import secrets
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any, Self

from minerva_bus.collect.data_tables import Data, Writer, check_table, create_writer, table_path
from minerva_bus.collect.plans import TablePlan
from minerva_bus.files import check_output, name_file, target_of


class TableFiles:
    """The files of several tables; a context manager that removes drafts after an error.

    Args:
        path: of the file, or the pattern of several, see `table_path`.
        several: whether the names of files contain those of tables.
        sparse: whether a table without rows has no file.

    `files` are the paths by table. Raises MisuseError for a path that cannot be written.

    """

    def __init__(self, path: Path, *, several: bool, sparse: bool) -> None:
        check_table(path)
        self.files: dict[str, Path] = {}
        self._path = path
        self._several = several
        self._sparse = sparse
        self._drafts: dict[Path, Path] = {}

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, _: object
    ) -> None:
        name_file(error, self._path)
        for final, draft in self._drafts.items():
            if kind is not None:
                draft.unlink(missing_ok=True)
            elif draft != final:
                draft.replace(final)

    def open(self, plan: TablePlan) -> Writer:
        """The writer of a table."""
        path = table_path(self._path, plan.name, self._several)
        # Before the rows, which may take long.
        check_output(path, f"the table {plan.name}")
        final = target_of(path)

        def create() -> Writer:
            # A pipe or a device is written directly.
            special = final.exists() and not final.is_file()
            hidden = f".{final.stem}.{secrets.token_hex(4)}{final.suffix}"
            draft = final if special else final.with_name(hidden)
            # Noted first, because a file that is made may lack room for its beginning.
            self._drafts[final], self.files[plan.name] = draft, path
            return create_writer(draft, plan.columns, path)

        return _OnDemand(create) if self._sparse else create()


class _OnDemand:
    """A writer that is created for the first row."""

    def __init__(self, create: Callable[[], Writer]) -> None:
        self._create = create
        self._writer: Writer | None = None

    def row(self, values: Mapping[str, Any]) -> None:
        self._own().row(values)

    def rows(self, columns: Mapping[str, Data]) -> None:
        if len(next(iter(columns.values()))):
            self._own().rows(columns)

    def close(self) -> None:
        if self._writer is not None:
            self._writer.close()

    def _own(self) -> Writer:
        writer = self._writer = self._writer or self._create()
        return writer
