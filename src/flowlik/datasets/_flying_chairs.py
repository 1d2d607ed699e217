"""FlyingChairs: rendered chairs over photographs, with exact flow."""

from __future__ import annotations

from pathlib import Path

from flowlik.datasets._pairs import ImagePair, ImagePairs
from flowlik.errors import DataError
from flowlik.support.files import printable

IMAGES = (("img1", "img2"), ("img0", "img1"))
"""Ends of the names of first and second image: of the release, and of samples that count from 0."""

SUFFIXES = (".ppm", ".png", ".jpg")


class FlyingChairs(ImagePairs):
    """The pairs of FlyingChairs (Dosovitskiy et al. 2015), a `PairSequence`.

    ``NNNNN_img1.ppm``, ``NNNNN_img2.ppm``, ``NNNNN_flow.flo``; samples named ``0img0.ppm``, ``0img1.ppm``,
    ``0flow.flo`` are read too, and images as PNG or JPEG. The flow is exact, motions are affine and in the
    plane; occlusion is not told.

    Parameters
    ----------
    folder : Path or str
        The folder of the files (``data`` of the release), or the one that holds ``data``.

    Raises
    ------
    DataError
        If there is no flow, or a flow lacks an image.
    """

    def __init__(self, folder: Path | str) -> None:
        folder = Path(folder)
        if not folder.is_dir():
            raise DataError(f"{folder}: no such folder")
        inside = folder / "data" if (folder / "data").is_dir() else folder
        names = {path.name for path in inside.iterdir()}
        flows = sorted(name for name in names if name.endswith("flow.flo"))
        if not flows:
            raise DataError(f"{inside}: no NNNNN_flow.flo, not a FlyingChairs folder")
        pairs = [_pair(inside, names, flow) for flow in flows]
        super().__init__(f"flying-chairs/{printable(folder.resolve().name)}", pairs)


def _pair(folder: Path, names: set[str], flow: str) -> ImagePair:
    stem = flow.removesuffix("flow.flo")
    for first, second in IMAGES:
        for suffix in SUFFIXES:
            images = stem + first + suffix, stem + second + suffix
            if images[0] in names and images[1] in names:
                return ImagePair(folder / images[0], folder / images[1], folder / flow)
    raise DataError(f"{folder / flow}: its images {stem}img1.ppm and {stem}img2.ppm are not both there")
