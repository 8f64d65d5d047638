"""From bytes to pictures: whole ones come through, torn ones are told, and nothing else escapes."""

from __future__ import annotations

import contextlib
from functools import cache

import cv2
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from drivers.camera.pictures import Bytes, GarbledError, jpeg_size, picture_of
from tests.drivers.twin import rig

SIZE = (640, 480)


@cache
def jpeg(quality: int = 92) -> bytes:
    view, _ = rig.twin().expose(0.0, 0.004, 1.0, 1)
    return cv2.imencode(".jpg", view, [cv2.IMWRITE_JPEG_QUALITY, quality])[1].tobytes()


def as_array(data: bytes) -> Bytes:
    return np.frombuffer(data, np.uint8)


def decoded(data: bytes):
    return picture_of(as_array(data), "MJPG", SIZE)


def test_a_whole_jpeg_is_its_picture() -> None:
    view, _ = rig.twin().expose(0.0, 0.004, 1.0, 1)
    assert np.abs(decoded(jpeg()).astype(int) - view).mean() < 3.0
    assert jpeg_size(as_array(jpeg())) == SIZE


def test_zeros_that_a_camera_fills_its_buffer_with_do_no_harm() -> None:
    assert decoded(jpeg() + bytes(512)).shape == (480, 640, 3)


def test_a_jpeg_without_huffman_tables_as_cameras_send_it_is_a_picture() -> None:
    """UVC cameras leave out the standard tables (UVC MJPEG payload, 2.1)."""
    plain = cv2.imencode(".jpg", decoded(jpeg()), [cv2.IMWRITE_JPEG_QUALITY, 90, cv2.IMWRITE_JPEG_OPTIMIZE, 0])[1]
    data = bytearray(plain.tobytes())
    bare = without_tables(bytes(data))
    assert len(bare) < len(data)
    assert np.array_equal(decoded(bare), decoded(bytes(data)))


def without_tables(data: bytes) -> bytes:
    out, at = bytearray(data[:2]), 2
    while True:
        length = int.from_bytes(data[at + 2 : at + 4], "big") + 2
        if data[at + 1] == 0xDA:
            return bytes(out + data[at:])
        if data[at + 1] != 0xC4:
            out += data[at : at + length]
        at += length


@pytest.mark.parametrize("share", [0.0, 0.001, 0.01, 0.1, 0.3, 0.7, 0.95, 0.999])
def test_a_jpeg_that_breaks_off_is_garbled(share: float) -> None:
    with pytest.raises(GarbledError):
        decoded(jpeg()[: int(share * len(jpeg()))])


def test_a_jpeg_with_a_lost_packet_is_garbled() -> None:
    """3 kB, a packet of USB 2, lost anywhere in the scan."""
    data = jpeg()
    found = 0
    places = range(1000, len(data) - 4000, 2500)
    for at in places:
        try:
            decoded(data[:at] + data[at + 3072 :])
        except GarbledError:
            found += 1
    assert found == len(places)


def test_a_picture_of_another_size_is_told_with_both_sizes() -> None:
    small = cv2.imencode(".jpg", np.full((240, 320, 3), 90, np.uint8))[1].tobytes()
    with pytest.raises(GarbledError, match="320x240 where 640x480"):
        decoded(small)


def test_a_dark_and_a_white_picture_are_whole() -> None:
    for code in (0, 1, 5, 255):
        data = cv2.imencode(".jpg", np.full((480, 640, 3), code, np.uint8))[1].tobytes()
        assert abs(int(decoded(data).mean()) - code) <= 1


def test_yuyv_is_a_picture_and_a_short_one_is_garbled() -> None:
    grey = np.full((480, 640, 2), 128, np.uint8)
    assert abs(int(picture_of(grey, "YUYV", SIZE).mean()) - 130) < 3
    with pytest.raises(GarbledError, match="614400"):
        picture_of(grey.reshape(-1)[:-640], "YUYV", SIZE)


@settings(max_examples=300, deadline=None)
@given(st.binary(max_size=400))
def test_any_bytes_are_a_picture_or_garbled(data: bytes) -> None:
    for text in (data, b"\xff\xd8" + data, b"\xff\xd8" + data + b"\xff\xd9"):
        with pytest.raises(GarbledError):
            decoded(text)


@settings(max_examples=150, deadline=None)
@given(st.data())
def test_a_jpeg_with_any_bytes_turned_is_a_picture_or_garbled(data: st.DataObject) -> None:
    text = bytearray(jpeg())
    for _ in range(data.draw(st.integers(1, 8))):
        text[data.draw(st.integers(0, len(text) - 1))] ^= data.draw(st.integers(1, 255))
    with contextlib.suppress(GarbledError):
        assert decoded(bytes(text)).shape == (480, 640, 3)
