"""The end of a world: collects the reports of members and adds up their figures."""

from __future__ import annotations

from collections.abc import Iterable

from minerva_bus.frame.messages import Figures


class Shutdown:
    """The reason for the end of the world, and the reports of its members.

    `failed`: it ends prematurely because of an error. `pending`: members that have
    not reported yet.
    """

    def __init__(self) -> None:
        self.reason = ""
        self.failed = False
        self.pending: set[str] = set()
        self._figures: dict[str, Figures] = {}
        self._departed: dict[str, bool] = {}

    def begin(self, members: Iterable[str]) -> None:
        """Wait for the reports of these members."""
        self.pending = set(members)

    def report(self, member: str, figures: Figures) -> None:
        """Note a member's report; empty figures mean that it can no longer report."""
        if member in self.pending:  # A member that was dropped does not count.
            self.pending.discard(member)
            self._figures[member] = figures

    def depart(self, member: str) -> None:
        """Note that a member is gone; its report may still arrive."""
        self._departed.setdefault(member, False)

    def drop_departed(self) -> None:
        """Stop waiting for members that were already gone at the last call of this method.

        A token's departure may overtake the last message, so they get one more interval.
        """
        for member, missed in sorted(self._departed.items()):
            self._departed[member] = True
            if missed:
                self.report(member, {})

    def add_figures(self, source: str, figures: Figures) -> None:
        """Add figures that no member reported."""
        self._figures[source] = figures

    def total(self) -> Figures:
        """The figures of all members; numbers of the same name are added."""
        total: dict[str, bool | int | float | str] = {}
        # Sorted, because floating-point sums and the texts that remain depend on the order.
        for _, figures in sorted(self._figures.items()):
            for name, value in figures.items():
                old = total.get(name)
                both = isinstance(old, int | float) and isinstance(value, int | float)
                total[name] = old + value if both and old is not None else value  # pyright: ignore
        return total
