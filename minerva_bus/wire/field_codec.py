"""What a codec of a message's field has: its functions, and the declaration of the field."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any, TypeAlias

from minerva_bus.frame.messages import AtLeast, AtMost, Mark, Note, Within
from minerva_bus.wire.limits import check
from minerva_bus.wire.reader import Reader

Read: TypeAlias = Callable[[Reader, Any], Any]
Write: TypeAlias = Callable[..., Any]


@dataclass(frozen=True, slots=True)
class FieldCodec:
    """Codec of one field: `read` checks plain data, `write` makes it; None: values are plain.

    `text`: its type in PROTOCOL.md. `write` also takes the values of the fields `Within` this one.
    """

    text: str
    read: Read
    write: Write | None = None


@dataclass(frozen=True, slots=True)
class DeclaredField:
    """A field of a message: its name, its type and its marks."""

    message: str
    name: str
    type: Any
    marks: tuple[object, ...] = ()
    default: Any = None
    what: str = field(init=False)

    def __post_init__(self) -> None:
        object.__setattr__(self, "what", f"{self.message}: {self.name}")

    def has(self, mark: Mark) -> bool:
        """Whether the field has a mark."""
        return mark in self.marks

    @property
    def note(self) -> str:
        """Its description in PROTOCOL.md."""
        return next((mark.text for mark in self.marks if isinstance(mark, Note)), "")

    @property
    def least(self) -> int | None:
        """Minimum of a number, or None."""
        return next((mark.value for mark in self.marks if isinstance(mark, AtLeast)), None)

    @property
    def host(self) -> str:
        """The field whose map it shares, or empty if it has its own item."""
        return next((mark.field for mark in self.marks if isinstance(mark, Within)), "")

    @property
    def travels(self) -> bool:
        """Whether its value is part of the message."""
        return not (self.has(Mark.FROM_KEY) or self.has(Mark.LOCAL))

    def check_count(self, reader: Reader, count: int) -> None:
        """Raise ProtocolError if a list or map has more values than its limit allows."""
        for mark in self.marks:
            if isinstance(mark, AtMost):
                unit = mark.limit if mark.limit == self.name else f"{mark.limit} in {self.name}"
                check(self.message, count, getattr(reader.limits, mark.limit), unit)
