"""The part of msgpack that this project uses; the package itself has no types."""

from collections.abc import Callable
from typing import Any, NamedTuple

class ExtType(NamedTuple):
    code: int
    data: bytes

def packb(o: Any) -> bytes: ...
def unpackb(
    packed: bytes, *, ext_hook: Callable[[int, bytes], Any] = ..., strict_map_key: bool = ...
) -> Any: ...
