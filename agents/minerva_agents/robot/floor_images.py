"""Images of floors: PGM, decoded here, and all formats of Pillow.

Files are untrusted: their size is checked before they are read, and that of the image before it is
decoded. Each error is a MapError that names the file.
"""

import re
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from minerva_agents.robot.grids import MapError
from minerva_bus.outputs import note_read
from minerva_bus.wording import install

# Limits of the memory that a damaged or hostile file can take.
_MAX_CELLS = 100_000_000
_MAX_BYTES = 800_000_000

INSTALL = f"install it with: {install('maps')}"


@dataclass(frozen=True, slots=True)
class FloorImage:
    """Brightness levels from 0 to `most`, (height, width), top row first, and hidden pixels."""

    levels: NDArray[np.uint16]
    most: int
    hidden: NDArray[np.bool_] | None = None


def read_image(path: Path) -> FloorImage:
    """Decode an image file; raises MapError, naming the file, for invalid input."""
    data = read_bytes(path, _MAX_BYTES)
    is_pgm = path.suffix.lower() == ".pgm" or data[:2] in (b"P2", b"P5")
    return _read_pgm(path, data) if is_pgm else _read_with_pillow(path)


def read_bytes(path: Path, most: int) -> bytes:
    """Contents of a file of at most `most` bytes; raises MapError, naming the file."""
    try:
        if not path.is_file():
            raise MapError(f"{path}: not a file; expected a map or its image. Check the name")
        size = path.stat().st_size
        if size > most:
            raise MapError(f"{path}: has {size} bytes; expected at most {most}")
        note_read(path)
        return path.read_bytes()
    except OSError as error:
        raise MapError(f"{path}: cannot read: {error.strerror}; check its permissions") from None


def _check_size(path: Path, width: int, height: int) -> None:
    if not 0 < width * height <= _MAX_CELLS:
        raise MapError(
            f"{path}: the image is {width} x {height}; expected 1 to {_MAX_CELLS} pixels. "
            "Scale it down or use a coarser resolution"
        )


_SPACE = b" \t\n\v\f\r"
_GAP = re.compile(rb"(?:[ \t\n\v\f\r]|#[^\n\r]*[\n\r])+")
_NUMBER = re.compile(rb"[0-9]{1,9}(?![0-9])")
_COMMENT = re.compile(rb"#[^\n\r]*")


def _read_pgm(path: Path, data: bytes) -> FloorImage:
    """Decode a PGM image, plain (P2) or raw (P5), 8 or 16 bits, as specified in netpbm's pgm(5)."""
    if data[:2] not in (b"P2", b"P5"):
        raise MapError(f"{path}: starts with {data[:2]!r}; expected P2 or P5, a PGM image")
    width, at = _header_number(path, data, 2, "width")
    height, at = _header_number(path, data, at, "height")
    most, at = _header_number(path, data, at, "maxval")
    _check_size(path, width, height)
    if not 1 <= most <= 65535:
        raise MapError(f"{path}: maxval is {most}; expected 1 to 65535")
    if at >= len(data) or data[at] not in _SPACE:
        raise MapError(f"{path}: maxval is followed by {data[at : at + 1]!r}; expected white space")
    read_levels = _plain_levels if data[:2] == b"P2" else _raw_levels
    levels = read_levels(path, data[at + 1 :], width * height, most)
    if levels.max() > most:
        raise MapError(f"{path}: a pixel is {levels.max()}; expected at most maxval, {most}")
    return FloorImage(levels.astype(np.uint16).reshape(height, width), most)


def _header_number(path: Path, data: bytes, at: int, name: str) -> tuple[int, int]:
    """The number after a gap, and the offset where it ends."""
    gap = _GAP.match(data, at)
    number = gap and _NUMBER.match(data, gap.end())
    if not number:
        raise MapError(
            f"{path}: {name} is invalid: {data[at : at + 12]!r} at byte {at}; "
            "expected white space and a number of at most 9 digits"
        )
    return int(number.group()), number.end()


def _raw_levels(path: Path, body: bytes, count: int, most: int) -> NDArray[np.integer]:
    kind = np.dtype(np.uint8 if most < 256 else ">u2")
    size = count * kind.itemsize
    if len(body) < size or body[size:].strip(_SPACE):
        raise MapError(
            f"{path}: {len(body)} bytes follow the header; expected {size}, "
            f"{kind.itemsize} for each of {count} pixels. The file is damaged"
        )
    return np.frombuffer(body, kind, count)


def _plain_levels(path: Path, body: bytes, count: int, _most: int) -> NDArray[np.integer]:
    words = _COMMENT.sub(b"", body).split()
    if len(words) != count:
        raise MapError(
            f"{path}: {len(words)} numbers follow the header; expected {count}, "
            "one per pixel. The file is damaged"
        )
    strange = next((word for word in words if not _NUMBER.fullmatch(word)), None)
    if strange is not None:
        raise MapError(f"{path}: invalid pixel {strange[:20]!r}; expected a number")
    return np.array([int(word) for word in words], np.int64)


def _read_with_pillow(path: Path) -> FloorImage:
    try:
        from PIL import Image  # late: maps in PGM need no library
    except ImportError:
        raise MapError(f"{path}: images other than PGM need Pillow; {INSTALL}") from None
    try:
        note_read(path)
        with Image.open(path) as image:
            # Pillow has read the header only, so an image that is too large is rejected before it
            # is decoded.
            _check_size(path, *image.size)
            # Modes of 16 and 32 bits, which RGBA would cut off.
            deep = image.mode.startswith("I")
            if image.mode in ("1", "L") and not image.has_transparency_data:
                # The same brightness as below, without four channels.
                return FloorImage(np.asarray(image.convert("L"), np.uint16), 255)
            pixels = np.asarray(image if deep else image.convert("RGBA"))
    except MapError:
        raise
    except Exception as error:  # decoders raise many types for damaged files
        raise MapError(f"{path}: not a readable image: {error}; expected PGM or PNG") from None
    if deep:
        return FloorImage(np.clip(pixels, 0, 65535).astype(np.uint16), 65535)
    # The sum instead of the mean of the channels, which would have to be rounded.
    shades = pixels[..., :3].sum(axis=2, dtype=np.uint16)
    return FloorImage(shades, 3 * 255, pixels[..., 3] < 255)
