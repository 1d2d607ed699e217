"""KITTI flow 2012 and 2015: image pairs with sparse true flow."""

from __future__ import annotations

from pathlib import Path
from typing import ClassVar

import numpy as np
from numpy.typing import NDArray

from flowlik.datasets._images import of_size
from flowlik.datasets._pairs import ImagePair, ImagePairs, by_stem
from flowlik.datasets.base import lacks
from flowlik.datasets.flow_files import read_flow
from flowlik.datasets.kitti import IMAGE_KINDS
from flowlik.errors import DataError
from flowlik.support.files import printable

IMAGES = {"image_2": "2015", "image_0": "2012", "colored_0": "2012"}
"""Image folders in the order of preference, each with the year of its benchmark."""

TRUTH = ("flow_occ", "flow_noc")
"""Folders of true flow: with occluded pixels, which are kept, else without."""


class KittiFlow(ImagePairs):
    """The pairs of the KITTI flow benchmark of 2012 or 2015 (Geiger, Menze), a `PairSequence`.

    ``image_2`` (2015), ``image_0`` or ``colored_0`` (2012; grey is preferred) hold pairs ``NNNNNN_10.png``,
    ``NNNNNN_11.png`` (or JPEG), and ``flow_occ`` or ``flow_noc`` the flow (16-bit PNG, steps of 1/64 px).
    The truth is that of a laser scanner, sparse, and mostly on the ground and near things; moving cars of
    2015 are fitted models.

    Parameters
    ----------
    folder : Path or str
        ``training``, or ``testing``, which has no truth.

    Raises
    ------
    DataError
        If there are no images, one lacks its partner, or there are two of one number.
    """

    png: ClassVar[str | None] = "kitti"
    measured_truth: ClassVar[bool] = True

    def __init__(self, folder: Path | str) -> None:
        self.folder = Path(folder)
        if not self.folder.is_dir():
            raise DataError(f"{self.folder}: no such folder")
        images = next((self.folder / name for name in IMAGES if (self.folder / name).is_dir()), None)
        if images is None:
            raise DataError(f"{self.folder}: no folder {' or '.join(IMAGES)}, not a KITTI flow folder")
        firsts, seconds = (by_stem(images, f"[0-9]+_{n}", IMAGE_KINDS) for n in (10, 11))
        if not firsts:
            raise DataError(f"{images}: no images NNNNNN_10.png")
        for start in sorted({stem[:-2] for stem in (*firsts, *seconds)}):
            for n, found in ((10, firsts), (11, seconds)):
                if f"{start}{n}" not in found:
                    path, partner = images / f"{start}{n}.png", f"{start}{21 - n}"
                    raise DataError(f"{path}: no such image, the partner of {partner}")
        truth = next((self.folder / name for name in TRUTH if (self.folder / name).is_dir()), None)
        pairs = [
            ImagePair(first, seconds[f"{stem[:-2]}11"], truth and truth / f"{stem}.png")
            for stem, first in firsts.items()
        ]
        super().__init__(f"kitti-flow/{IMAGES[images.name]}-{printable(self.folder.resolve().name)}", pairs)

    def visible(self, k: int) -> NDArray[np.bool_]:
        """Return which pixels (H, W) of frame k have true flow and stay in sight, those of ``flow_noc``.

        Raises
        ------
        MissingFieldError
            If there is no such file.
        DataError
            If k is a second frame or there is no such frame, or the file is unreadable or of another
            size.
        """
        i = self.pair_index(k)
        first = self.pairs[i].first
        path = self.folder / "flow_noc" / f"{first.stem}.png"
        if not path.is_file():
            raise lacks(self.name, f"visibility for {first.name} (no {path})")
        flow = of_size(read_flow(path, self.png), self._shape(i), path, first.name)
        return np.asarray(np.isfinite(flow).all(axis=-1))
