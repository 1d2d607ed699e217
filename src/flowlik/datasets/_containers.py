"""Containers of videos: which one a file is, and whether it is all there."""

from __future__ import annotations

from pathlib import Path
from typing import BinaryIO

ISO, MATROSKA, AVI, MPEG_PROGRAM = "ISO (mp4, mov)", "Matroska", "AVI", "MPEG program stream"

MOST_BOXES = 1_000_000

_FIRST_BOXES = (b"ftyp", b"moov", b"mdat", b"free", b"skip", b"wide", b"pnot", b"uuid", b"moof", b"styp")
_EBML, _SEGMENT = b"\x1a\x45\xdf\xa3", b"\x18\x53\x80\x67"


def container_of(path: Path) -> str | None:
    """Container of a video by its first bytes, or None where it is another."""
    with path.open("rb") as file:
        start = file.read(12)
    if start[4:8] in _FIRST_BOXES:
        return ISO
    if start[:4] == _EBML:
        return MATROSKA
    if start[:4] == b"RIFF" and start[8:] == b"AVI ":
        return AVI
    return MPEG_PROGRAM if start[:4] == b"\0\0\1\xba" else None


def is_all_there(path: Path) -> bool:
    """Whether a video file is as long as its parts say; True for containers that do not say."""
    kinds = {ISO: _iso_end, MATROSKA: _matroska_end, AVI: _avi_end}
    end_of = kinds.get(container_of(path) or "")
    if end_of is None:
        return True
    size = path.stat().st_size
    with path.open("rb") as file:
        return end_of(file, size) <= size


def _iso_end(file: BinaryIO, size: int) -> int:
    """Where the last box ends: each begins with its size and name."""
    at = 0
    for _ in range(MOST_BOXES):
        file.seek(at)
        head = file.read(16)
        if len(head) < 8 or not all(32 <= byte < 127 or byte == 169 for byte in head[4:8]):
            return at
        length = int.from_bytes(head[:4], "big")
        if length == 1:  # a long one
            length = int.from_bytes(head[8:16], "big")
        if length < 8:  # 0: to the end of the file
            return at
        at += length
        if at >= size:
            return at
    return at


def _avi_end(file: BinaryIO, size: int) -> int:
    """Where the last RIFF list ends; long files have several."""
    at = 0
    for _ in range(MOST_BOXES):
        file.seek(at)
        head = file.read(8)
        if len(head) < 8 or head[:4] != b"RIFF":
            return at
        at += 8 + int.from_bytes(head[4:], "little")
        at += at % 2 if at < size else 0
        if at >= size:
            return at
    return at


def _matroska_end(file: BinaryIO, size: int) -> int:
    """Where the segment ends, after the header; 0 where it was recorded without saying."""
    at = 0
    for name in (_EBML, _SEGMENT):
        file.seek(at)
        head = file.read(12)
        if head[:4] != name or len(head) < 5 or head[4] == 0:
            return 0
        width = 9 - head[4].bit_length()
        bits = int.from_bytes(head[4 : 4 + width], "big")
        length = bits & ((1 << 7 * width) - 1)
        if length == (1 << 7 * width) - 1:  # unknown
            return 0
        at += 4 + width + length
    return at
