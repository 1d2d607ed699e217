"""What an image file claims, and whether it is all there.

OpenCV, depending on format and version, hands out half-decoded images, and asks for as much memory as a
header claims.
"""

from __future__ import annotations

import struct
import zlib

DEFLATE_RATIO = 1032
"""The most bytes that one byte of a deflate stream can stand for."""


def claimed_size(data: bytes) -> tuple[int, int] | None:
    """Width and height that the header of an image file claims, or None in formats not known here."""
    try:
        if data.startswith(b"\x89PNG\r\n\x1a\n"):
            return struct.unpack_from(">II", data, 16)
        if data.startswith(b"\xff\xd8"):
            return _jpeg_size(data)
        if data[:1] == b"P" and data[1:2] in b"123456":
            values, _ = _pnm_values(data, 2)
            return (values[0], values[1]) if len(values) == 2 else None
        if data.startswith(b"BM"):
            width, height = struct.unpack_from("<ii", data, 18)
            return abs(width), abs(height)
        if data.startswith((b"II*\0", b"MM\0*")):
            return _tiff_size(data)
        if data.startswith(b"GIF8"):
            return struct.unpack_from("<HH", data, 6)
        if data.startswith(b"RIFF") and data[8:12] == b"WEBP":
            return _webp_size(data)
    except struct.error:
        pass
    return None


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
    if len(data) < 33 or _png_bytes(data) > DEFLATE_RATIO * len(data):
        return False
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


def _png_bytes(data: bytes) -> int:
    """Bytes of pixels that a PNG's header promises."""
    width, height, bits, kind = struct.unpack_from(">IIBB", data, 16)
    channels = {2: 3, 4: 2, 6: 4}.get(kind, 1)
    return int(height * ((width * channels * bits + 7) // 8))


def _pnm(data: bytes) -> bool:
    """Header: magic, width, height and largest value, separated by white space or comments, then one byte."""
    values, at = _pnm_values(data, 3)
    if len(values) < 3:
        return False
    width, height, largest = values
    channels, size = (3 if data[:2] == b"P6" else 1), (2 if largest > 255 else 1)
    return len(data) >= at + 1 + width * height * channels * size


def _pnm_values(data: bytes, count: int) -> tuple[list[int], int]:
    """The first numbers of a header, fewer where it is no such header, and where they end."""
    values: list[int] = []
    at = 2
    while len(values) < count:
        while data[at : at + 1].isspace():
            at += 1
        if data[at : at + 1] == b"#":
            at = data.find(b"\n", at)
            if at < 0:
                break
            continue
        end = at
        while data[end : end + 1].isdigit() and end < at + 20:
            end += 1
        if end == at:
            break
        values.append(int(data[at:end]))
        at = end
    return values, at


def _jpeg_size(data: bytes) -> tuple[int, int] | None:
    """Size in the first frame header (SOF)."""
    at = 2
    while True:
        marker, length = struct.unpack_from(">HH", data, at)
        if 0xFFC0 <= marker <= 0xFFCF and marker not in (0xFFC4, 0xFFC8, 0xFFCC):
            height, width = struct.unpack_from(">HH", data, at + 5)
            return width, height
        if marker == 0xFFFF:
            at += 1
        elif marker < 0xFF00 or length < 2:
            return None
        else:
            at += 2 + length


def _tiff_size(data: bytes) -> tuple[int, int]:
    """Tags 256 and 257 of the first directory."""
    order = "<" if data[:2] == b"II" else ">"
    (start,) = struct.unpack_from(order + "I", data, 4)
    (entries,) = struct.unpack_from(order + "H", data, start)
    size = {256: 0, 257: 0}
    for i in range(entries):
        tag, kind = struct.unpack_from(order + "HH", data, start + 2 + 12 * i)
        if tag in size:
            (size[tag],) = struct.unpack_from(order + ("H" if kind == 3 else "I"), data, start + 10 + 12 * i)
    return size[256], size[257]


def _webp_size(data: bytes) -> tuple[int, int] | None:
    """Size of a lossy, lossless or extended WebP."""
    if data[12:16] == b"VP8X":
        width, height = (int.from_bytes(data[at : at + 3], "little") for at in (24, 27))
        return width + 1, height + 1
    if data[12:16] == b"VP8L":
        (bits,) = struct.unpack_from("<I", data, 21)
        return (bits & 0x3FFF) + 1, (bits >> 14 & 0x3FFF) + 1
    width, height = struct.unpack_from("<HH", data, 26)
    return width & 0x3FFF, height & 0x3FFF
