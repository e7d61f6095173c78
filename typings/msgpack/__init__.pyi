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

class Packer:
    def pack(self, obj: Any) -> bytes: ...

class OutOfData(Exception): ...

class Unpacker:
    def __init__(
        self,
        *,
        ext_hook: Callable[[int, bytes], Any] = ...,
        strict_map_key: bool = ...,
        max_buffer_size: int = ...,
    ) -> None: ...
    def feed(self, next_bytes: bytes | memoryview) -> None: ...
    def unpack(self) -> Any: ...
    def tell(self) -> int: ...
