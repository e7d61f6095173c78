"""Tables in Arrow's C data interface, so that no Arrow library is needed here.

Source: the Arrow C data interface, C stream interface and PyCapsule interface, as specified at
https://arrow.apache.org/docs/format/CDataInterface.html. A consumer copies the structures and calls
`release`; Python memory stays alive in `_exported` until then.
"""

from __future__ import annotations

import ctypes as c
from collections.abc import Mapping
from itertools import count
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

FORMATS: Final = {"float64": b"g", "int64": b"l", "bool": b"b", "text": b"U"}
_NULLABLE: Final = 2
_PARENTS: Final = b"+s"


class _Schema(c.Structure):
    pass


class _Array(c.Structure):
    pass


class _Stream(c.Structure):
    pass


_RELEASE_SCHEMA = c.CFUNCTYPE(None, c.POINTER(_Schema))
_RELEASE_ARRAY = c.CFUNCTYPE(None, c.POINTER(_Array))
_RELEASE_STREAM = c.CFUNCTYPE(None, c.POINTER(_Stream))
_GET_SCHEMA = c.CFUNCTYPE(c.c_int, c.POINTER(_Stream), c.POINTER(_Schema))
_GET_NEXT = c.CFUNCTYPE(c.c_int, c.POINTER(_Stream), c.POINTER(_Array))
_GET_ERROR = c.CFUNCTYPE(c.c_char_p, c.POINTER(_Stream))

_Schema._fields_ = [
    ("format", c.c_char_p),
    ("name", c.c_char_p),
    ("metadata", c.c_char_p),
    ("flags", c.c_int64),
    ("n_children", c.c_int64),
    ("children", c.POINTER(c.POINTER(_Schema))),
    ("dictionary", c.POINTER(_Schema)),
    ("release", _RELEASE_SCHEMA),
    ("private_data", c.c_void_p),
]
_Array._fields_ = [
    ("length", c.c_int64),
    ("null_count", c.c_int64),
    ("offset", c.c_int64),
    ("n_buffers", c.c_int64),
    ("n_children", c.c_int64),
    ("buffers", c.POINTER(c.c_void_p)),
    ("children", c.POINTER(c.POINTER(_Array))),
    ("dictionary", c.POINTER(_Array)),
    ("release", _RELEASE_ARRAY),
    ("private_data", c.c_void_p),
]
_Stream._fields_ = [
    ("get_schema", _GET_SCHEMA),
    ("get_next", _GET_NEXT),
    ("get_last_error", _GET_ERROR),
    ("release", _RELEASE_STREAM),
    ("private_data", c.c_void_p),
]

_exported: dict[int, Any] = {}
"""Objects that consumers still use, by `private_data`."""
_numbers = count(1)


def _keep(*things: Any) -> int:
    # Structures of ctypes have addresses only, so their Python objects are kept here.
    number = next(_numbers)
    _exported[number] = things
    return number


def _released(pointer: Any) -> None:
    """Release an exported structure, and its children, which a consumer may have moved."""
    structure = pointer.contents
    for n in range(getattr(structure, "n_children", 0)):
        child = structure.children[n]
        # A consumer that has taken a child over has set its `release` to null.
        if child and child.contents.release:
            child.contents.release(child)
    _exported.pop(structure.private_data, None)
    # A null `release` marks a structure as released; consumers check for it.
    structure.release = type(structure.release)()


_release_schema = _RELEASE_SCHEMA(_released)
_release_array = _RELEASE_ARRAY(_released)
_release_stream = _RELEASE_STREAM(_released)


def _fill_schema(schema: Any, form: bytes, name: bytes, children: list[Any]) -> None:
    pointers = (c.POINTER(_Schema) * len(children))(*[c.pointer(child) for child in children])
    schema.format, schema.name, schema.metadata = form, name, None
    schema.flags = 0 if form == _PARENTS else _NULLABLE
    schema.n_children = len(children)
    schema.children = c.cast(pointers, c.POINTER(c.POINTER(_Schema)))
    schema.dictionary = None
    schema.release = _release_schema
    schema.private_data = _keep(form, name, children, pointers)


def _fill_array(array: Any, length: int, buffers: list[Any], children: list[Any]) -> None:
    addresses = (c.c_void_p * len(buffers))(
        *[None if buffer is None else buffer.ctypes.data for buffer in buffers]
    )
    pointers = (c.POINTER(_Array) * len(children))(*[c.pointer(child) for child in children])
    array.length, array.null_count, array.offset = length, 0, 0
    array.n_buffers, array.n_children = len(buffers), len(children)
    array.buffers = c.cast(addresses, c.POINTER(c.c_void_p))
    array.children = c.cast(pointers, c.POINTER(c.POINTER(_Array)))
    array.dictionary = None
    array.release = _release_array
    array.private_data = _keep(buffers, addresses, children, pointers)


def _schema_of(schema: Any, types: Mapping[str, str]) -> None:
    children = [_Schema() for _ in types]
    for child, (name, kind) in zip(children, types.items(), strict=True):
        _fill_schema(child, FORMATS[kind], name.encode(), [])
    _fill_schema(schema, _PARENTS, b"", children)


def _array_of(array: Any, types: Mapping[str, str], columns: Mapping[str, NDArray[Any]]) -> None:
    children = [_Array() for _ in types]
    length = len(next(iter(columns.values()))) if columns else 0
    for child, (name, kind) in zip(children, types.items(), strict=True):
        # The validity buffer is null: no value is missing.
        _fill_array(child, length, [None, *buffers_of(kind, columns[name])], [])
    _fill_array(array, length, [None], children)


def buffers_of(kind: str, column: NDArray[Any]) -> list[NDArray[Any]]:
    """The buffers of a column in Arrow's layout, without that of validity."""
    if kind == "bool":
        return [np.packbits(column, bitorder="little")]
    if kind != "text":
        return [np.ascontiguousarray(column)]
    encoded = [text.encode() for text in column.tolist()]
    offsets = np.zeros(len(encoded) + 1, np.int64)
    np.cumsum(np.fromiter(map(len, encoded), np.int64, len(encoded)), out=offsets[1:])
    return [offsets, np.frombuffer(b"".join(encoded) or b"\0", np.uint8)]


# --- capsules ---

_Destructor = c.CFUNCTYPE(None, c.c_void_p)
_new = c.pythonapi.PyCapsule_New
_new.restype, _new.argtypes = c.py_object, [c.c_void_p, c.c_char_p, _Destructor]
_get = c.pythonapi.PyCapsule_GetPointer
_get.restype, _get.argtypes = c.c_void_p, [c.c_void_p, c.c_char_p]
_SCHEMA_NAME: Final = b"arrow_schema"
_STREAM_NAME: Final = b"arrow_array_stream"
_structures: dict[int, Any] = {}
"""The structures that capsules point to, by address."""


def _destroyed(name: bytes) -> Any:
    def destroy(capsule: int) -> None:
        structure = _structures.pop(_get(capsule, name), None)
        if structure is not None and structure.release:
            structure.release(c.pointer(structure))

    return _Destructor(destroy)


# Module variables, because a callback must exist for as long as any capsule that refers to it.
_destroy_schema, _destroy_stream = _destroyed(_SCHEMA_NAME), _destroyed(_STREAM_NAME)


def _capsule(structure: Any, name: bytes, destroy: Any) -> object:
    address = c.addressof(structure)
    _structures[address] = structure
    return _new(address, name, destroy)


def schema_capsule(types: Mapping[str, str]) -> object:
    """The capsule `arrow_schema` of columns with these types, by name."""
    schema = _Schema()
    _schema_of(schema, types)
    return _capsule(schema, _SCHEMA_NAME, _destroy_schema)


def stream_capsule(types: Mapping[str, str], columns: Mapping[str, NDArray[Any]]) -> object:
    """The capsule `arrow_array_stream` of these columns, in one batch."""
    left = [columns]

    def get_schema(_: Any, out: Any) -> int:
        _schema_of(out.contents, types)
        return 0

    def get_next(_: Any, out: Any) -> int:
        if left:
            _array_of(out.contents, types, left.pop())
        else:
            # A released array marks the end of the stream.
            out.contents.release = _RELEASE_ARRAY()
        return 0

    def get_error(_: Any) -> None:
        """None, because no call fails."""

    calls = _GET_SCHEMA(get_schema), _GET_NEXT(get_next), _GET_ERROR(get_error)
    # The callbacks must live for as long as the consumer may call them.
    stream = _Stream(*calls, _release_stream, _keep(calls))
    return _capsule(stream, _STREAM_NAME, _destroy_stream)
