"""From the bytes of a frame to its picture, and whether they are all there.

Decoders draw a torn frame without complaint, so the frame's own structure is checked before and after.
"""

from __future__ import annotations

from typing import Literal

import cv2
import numpy as np
import numpy.typing as npt

from drivers.camera.values import Image

PixelFormat = Literal["MJPG", "YUYV"]
Bytes = npt.NDArray[np.uint8]

_SOI, _EOI, _SOS = 0xD8, 0xD9, 0xDA
_FRAME_HEADS = {*range(0xC0, 0xD0)} - {0xC4, 0xC8, 0xCC}  # ITU T.81, table B.1
_ALONE = {0x01, *range(0xD0, 0xD8)}
_FILL_ROWS, _FILL_COLUMNS = 8, 32  # of the last block row
_DARK_CODE = 16  # below it a picture's noise may fall to the compression
_LONGEST_TAIL = 4096  # cameras pad frames with zeros


class GarbledError(ValueError):
    """A frame's bytes are not a whole picture; the text says what is wrong with them."""


def picture_of(data: Bytes, pixel_format: PixelFormat, size: tuple[int, int]) -> Image:
    """The (height, width, 3) BGR picture of a frame's bytes; ``size`` (width, height) is what the camera was set to.

    ``GarbledError`` for a frame that is torn, short or of another size.
    """
    return _jpeg(data, size) if pixel_format == "MJPG" else _yuyv(data, size)


def jpeg_size(data: Bytes) -> tuple[int, int]:
    """(width, height) by the header of a whole JPEG. ``GarbledError`` when it is torn."""
    raw = data.reshape(-1)
    if len(raw) < 4 or raw[0] != 0xFF or raw[1] != _SOI:
        raise GarbledError(f"{len(raw)} bytes without the head of a JPEG")
    size, scan = _headers(raw)
    _check_scan(raw, scan)
    return size


def _headers(raw: Bytes) -> tuple[tuple[int, int], int]:
    """The picture's (width, height), and where its scan begins."""
    size: tuple[int, int] | None = None
    at = 2
    while at + 4 <= len(raw):
        if raw[at] != 0xFF:
            raise GarbledError(f"a JPEG whose segments break off at byte {at}")
        kind = int(raw[at + 1])
        if kind == 0xFF or kind in _ALONE:
            at += 1 if kind == 0xFF else 2
            continue
        length = int(raw[at + 2]) << 8 | int(raw[at + 3])
        if length < 2 or at + 2 + length > len(raw):
            break
        if kind in _FRAME_HEADS and length >= 8:
            size = int(raw[at + 7]) << 8 | int(raw[at + 8]), int(raw[at + 5]) << 8 | int(raw[at + 6])
        at += 2 + length
        if kind == _SOS:
            if size is None or min(size) == 0:
                raise GarbledError("a JPEG without its size")
            return size, at
    raise GarbledError(f"a JPEG cut off in its head, after {len(raw)} bytes")


def _check_scan(raw: Bytes, begin: int) -> None:
    """The entropy-coded data end with the end mark, and hold no other (T.81, B.1.1.5)."""
    scan = raw[begin:]
    marks = np.flatnonzero(scan[:-1] == 0xFF)
    kinds = scan[marks + 1]
    true = (kinds != 0x00) & (kinds != 0xFF) & ((kinds < 0xD0) | (kinds > 0xD7))
    if not true.any():
        raise GarbledError(f"a JPEG cut off after {len(raw)} bytes")
    first = int(np.argmax(true))
    rest = len(scan) - int(marks[first]) - 2
    if kinds[first] != _EOI:
        raise GarbledError(f"a JPEG with a piece missing (mark {int(kinds[first]):#04x} in its data)")
    if rest > _LONGEST_TAIL or scan[len(scan) - rest :].any():
        raise GarbledError(f"a JPEG followed by {rest} bytes of something else")


def _jpeg(data: Bytes, size: tuple[int, int]) -> Image:
    found = jpeg_size(data)
    if found != size:
        raise GarbledError(f"a picture of {found[0]}x{found[1]} where {size[0]}x{size[1]} is set")
    try:
        picture = cv2.imdecode(data, cv2.IMREAD_COLOR | cv2.IMREAD_IGNORE_ORIENTATION)
    except cv2.error as error:
        raise GarbledError(f"a JPEG that cannot be decoded ({error.err})") from error
    if picture is None or picture.shape != (size[1], size[0], 3):
        raise GarbledError("a JPEG that cannot be decoded")
    image: Image = np.asarray(picture, dtype=np.uint8)
    if _filled_up(image):
        raise GarbledError("a JPEG with a piece missing: its last rows are the decoder's filling")
    return image


def _filled_up(picture: Image) -> bool:
    """Whether the bottom is one flat colour, neither dark nor white, which no sensor gives: the data ended early."""
    tail = picture[-_FILL_ROWS:, -_FILL_COLUMNS:].reshape(-1, 3)
    first = tail[0]
    return bool((tail == first).all() and first.max() > _DARK_CODE and first.min() < 255)


def _yuyv(data: Bytes, size: tuple[int, int]) -> Image:
    width, height = size
    raw = data.reshape(-1)
    if len(raw) != 2 * width * height:
        raise GarbledError(f"{len(raw)} bytes where {width}x{height} YUYV has {2 * width * height}")
    return np.asarray(cv2.cvtColor(raw.reshape(height, width, 2), cv2.COLOR_YUV2BGR_YUYV), dtype=np.uint8)
