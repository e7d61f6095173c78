"""Arrays of numbers and bools, and ids, as plain data: section 3 of PROTOCOL.md.

array = extension 3: a byte for the type, then the values, little endian
            d float64    b h i q integers of 1, 2, 4, 8 bytes    ? bools of 1 byte
ids   = [stem, array of integers] | [nil, width, bytes]
      | [stem, first, count]             consecutive numbers

Readers raise ProtocolError.
"""

from __future__ import annotations

from typing import Any, Final, cast

import msgpack
import numpy as np
from numpy.typing import NDArray

from minerva_bus.errors import ProtocolError
from minerva_bus.grammar.columns import MANY
from minerva_bus.grammar.ids import LONGEST, Ids
from minerva_bus.wire.plain import as_int, as_list, extension

ARRAY: Final = 3
_DTYPES: Final = {"d": "<f8", "b": "<i1", "h": "<i2", "i": "<i4", "q": "<i8", "?": "?"}

# Without the Python code of the methods of arrays, which takes longer for short ones.
_LEAST: Final = np.minimum.reduce
_MOST: Final = np.maximum.reduce

Rows = NDArray[np.intp]


def plain_array(array: NDArray[Any]) -> Any:
    """An array; integers in the narrowest type that holds them all."""
    # Most columns of integers are small numbers, so the narrowest type saves up to seven of eight
    # bytes. Reals are never narrowed: their bits enter the digest.
    letter = {"f": "d", "b": "?"}.get(array.dtype.kind) or _narrowest(array)
    data = array.astype(_DTYPES[letter], copy=False)
    return extension(ARRAY, letter.encode() + data.tobytes())


def _narrowest(array: NDArray[Any]) -> str:
    if not len(array):
        return "b"
    least, most = int(_LEAST(array)), int(_MOST(array))
    for letter, half in (("b", 1 << 7), ("h", 1 << 15), ("i", 1 << 31)):
        if -half <= least and most < half:
            return letter
    return "q"


def read_array(plain: Any) -> NDArray[Any]:
    """An array of float64, int64 or bool."""
    if not isinstance(plain, msgpack.ExtType) or plain.code != ARRAY or not plain.data:
        raise ProtocolError("a column must be extension 3 or a list of text")
    dtype = _DTYPES.get(chr(plain.data[0]))
    if dtype is None:
        raise ProtocolError(f"a column of type {plain.data[:1]!r}; expected one of dbhiq?")
    size = np.dtype(dtype).itemsize
    # numpy would raise an error of its own for remaining bytes.
    if (len(plain.data) - 1) % size:
        raise ProtocolError(f"a column of {size} bytes a value has {len(plain.data) - 1} bytes")
    array = np.frombuffer(plain.data, dtype, offset=1)
    if dtype == "?":
        # numpy takes any other byte for true as well, but the digest of a column hashes its bytes.
        if (array.view(np.uint8) > 1).any():
            raise ProtocolError("bools in a column must be bytes 0 or 1")
        return array
    # Copied even if the type is right: the bytes after the letter are unaligned and read-only.
    return array.astype(np.float64 if dtype == "<f8" else np.int64)


def plain_rows(rows: Rows) -> Any:
    """Row numbers."""
    return plain_array(rows.astype(np.int64))


def read_rows(plain: Any, count: int) -> Rows:
    """Ascending row numbers below a count."""
    rows = read_array(plain)
    if rows.dtype != np.int64:
        raise ProtocolError("rows must be integers")
    if len(rows) and (int(rows[0]) < 0 or int(rows[-1]) >= count or (rows[1:] <= rows[:-1]).any()):
        raise ProtocolError(f"rows must ascend, from 0, and be below {count}")
    return rows.astype(np.intp)


def plain_ids(ids: Ids | None) -> Any:
    """Ids of agents."""
    if ids is None:
        return None
    # Three values for any number of agents; common for generated populations.
    if len(ids) >= MANY and ids.consecutive:
        return [ids.stem, int(ids.data[0]), len(ids)]
    if ids.stem is not None:
        return [ids.stem, plain_array(ids.data)]
    # Equal ids have equal bytes, even if their array was wide enough for longer ids before.
    width = ids.data.dtype.itemsize
    cells = np.ascontiguousarray(ids.data).view(np.uint8).reshape(len(ids), width)
    while width > 1 and not cells[:, width - 1].any():
        width -= 1
    return [None, width, cells[:, :width].tobytes()]


def are_ids(plain: Any) -> bool:
    """Whether plain data are ids; a list of text has text as its second item."""
    if not isinstance(plain, list):
        return False
    items = cast("list[Any]", plain)
    return len(items) in (2, 3) and not isinstance(items[1], str)


def read_ids(plain: Any, count: int) -> Ids:
    """`count` ids."""
    items = as_list(plain, "ids")
    if len(items) == 3 and items[0] is None:
        ids = _spelled(items, count)
    elif len(items) in (2, 3) and isinstance(items[0], str):
        ids = Ids(items[0], _numbers(items[1:], count))
    else:
        raise ProtocolError("ids are [stem, numbers], [stem, first, count] or [nil, width, bytes]")
    if ids.too_long:
        raise ProtocolError(f"ids of more than {LONGEST} characters in columns")
    ids = ids.known()
    # Checked before the ids are decoded, because their bytes may not be UTF-8.
    if ids.strange is not None:
        raise ProtocolError(f"{ids.strange[:40]!r} is not a valid agent id")
    return ids


def _spelled(items: list[Any], count: int) -> Ids:
    width, data = as_int(items[1], "the width of ids", 1), items[2]
    # The product is compared before numpy gets the bytes, so the
    # count cannot be larger than the data.
    if width > LONGEST or not isinstance(data, bytes) or len(data) != width * count:
        raise ProtocolError(f"{count} ids of {width} bytes are {count * width} bytes in all")
    return Ids(None, np.frombuffer(data, f"S{width}"))


def _numbers(items: list[Any], count: int) -> NDArray[np.int64]:
    if len(items) == 1:
        numbers = read_array(items[0])
        if numbers.dtype != np.int64 or (len(numbers) and int(numbers.min()) < 0):
            raise ProtocolError("the numbers of ids must be whole numbers from 0")
        size = len(numbers)
    else:
        first, size = as_int(items[0], "the first of ids"), as_int(items[1], "the count of ids")
        if first + size > np.iinfo(np.int64).max:
            raise ProtocolError(f"ids from {first} on exceed 64 bits")
        # Made only if the count is right: a few bytes could request gigabytes of numbers.
        numbers = np.arange(first, first + size) if size == count else np.empty(0, np.int64)
    if size != count:
        raise ProtocolError(f"{size} ids; expected {count}")
    return numbers
