"""Is an image file all there? OpenCV, depending on format and version, hands out half-decoded images."""

from __future__ import annotations

import struct
import zlib


def is_whole(data: bytes) -> bool:
    """Whether the bytes of an image file reach its end; formats not known here are taken to be whole.

    PNG: every chunk is there with the right checksum, up to IEND. JPEG: an end-of-image marker follows
    the last scan. PGM and PPM (binary): the pixels the header promises. BMP and WebP: the size in the header.
    """
    if data.startswith(b"\x89PNG\r\n\x1a\n"):
        return _png(data)
    if data.startswith(b"\xff\xd8"):
        # Inside a scan 0xff is always escaped, so these two can only be markers.
        return data.rfind(b"\xff\xd9") > data.rfind(b"\xff\xda")
    if data[:2] in (b"P5", b"P6"):
        return _pnm(data)
    if data.startswith(b"BM") and len(data) >= 6:
        return len(data) >= struct.unpack_from("<I", data, 2)[0]
    if data.startswith(b"RIFF") and len(data) >= 8:
        return len(data) >= 8 + struct.unpack_from("<I", data, 4)[0]
    return True


def _png(data: bytes) -> bool:
    start = 8
    while start + 12 <= len(data):
        length, kind = struct.unpack_from(">I4s", data, start)
        end = start + 12 + length
        if end > len(data):
            return False
        if zlib.crc32(data[start + 4 : end - 4]) != struct.unpack_from(">I", data, end - 4)[0]:
            return False
        if kind == b"IEND":
            return True
        start = end
    return False


def _pnm(data: bytes) -> bool:
    """Header: magic, width, height and largest value, separated by white space or comments, then one byte."""
    values: list[int] = []
    at = 2
    while len(values) < 3:
        while data[at : at + 1].isspace():
            at += 1
        if data[at : at + 1] == b"#":
            at = data.find(b"\n", at)
            if at < 0:
                return False
            continue
        end = at
        while data[end : end + 1].isdigit():
            end += 1
        if end == at:
            return False
        values.append(int(data[at:end]))
        at = end
    width, height, largest = values
    channels, size = (3 if data[:2] == b"P6" else 1), (2 if largest > 255 else 1)
    return len(data) >= at + 1 + width * height * channels * size
