"""FlyingChairs: rendered chairs over photographs, with exact flow."""

from __future__ import annotations

from pathlib import Path

from flowlik.datasets._pairs import ImagePair, ImagePairs, by_stem
from flowlik.errors import DataError
from flowlik.support.files import printable

SUFFIXES = frozenset({".ppm", ".png", ".jpg", ".jpeg"})


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
        If there is no flow, a flow lacks an image or an image its flow, or there are two of one number.
    """

    def __init__(self, folder: Path | str) -> None:
        folder = Path(folder)
        if not folder.is_dir():
            raise DataError(f"{folder}: no such folder")
        inside = folder / "data" if (folder / "data").is_dir() else folder
        flows = by_stem(inside, ".*flow", {".flo"})
        if not flows:
            raise DataError(f"{inside}: no NNNNN_flow.flo, not a FlyingChairs folder")
        images = by_stem(inside, ".*img[012]", SUFFIXES)
        pairs = [_pair(images, flow) for flow in flows.values()]
        for image in images.values():
            if image.stem[:-4] + "flow" not in flows:
                raise DataError(f"{image}: its flow {image.stem[:-4]}flow.flo is not there")
        super().__init__(f"flying-chairs/{printable(folder.resolve().name)}", pairs)


def _pair(images: dict[str, Path], flow: Path) -> ImagePair:
    """Images 1 and 2 as in the release, or 0 and 1 as in samples that count from 0."""
    stem = flow.stem.removesuffix("flow")
    found = [path for i in range(3) if (path := images.get(f"{stem}img{i}")) is not None]
    if len(found) > 2:
        names = ", ".join(path.name for path in found)
        raise DataError(f"{flow}: three images ({names}), and nothing says which two it is between")
    if len(found) < 2 or f"{stem}img1" not in images:
        raise DataError(f"{flow}: its images {stem}img1.ppm and {stem}img2.ppm are not both there")
    first, second = found
    return ImagePair(first, second, flow)
