"""Flow that is already on disk: one file for each image pair of a sequence."""

from __future__ import annotations

import re
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import TYPE_CHECKING, ClassVar

import numpy as np
from numpy.typing import NDArray

from flowlik.datasets import Lens
from flowlik.datasets.flow_files import HDF5, SUFFIXES, read_flow
from flowlik.datasets.flow_png import check_coding
from flowlik.datasets.naming import in_order, places
from flowlik.datasets.undistorted import removed_lens
from flowlik.errors import DataError, ModelError
from flowlik.flow.base import NOT_RECORDED, DenseFlow, FlowMethod, FlowOfPairs, Image, as_dense, check_pair

if TYPE_CHECKING:
    from flowlik.datasets.base import ImageSequence

LABEL = re.compile(r"\w[\w.-]*")


@dataclass(frozen=True)
class FlowFiles(DenseFlow, FlowOfPairs):
    """Dense flow estimated elsewhere, in files that `flowlik.datasets.flow_files.read_flow` reads.

    The i-th file, by name and with numbers in it by value, is the flow of the i-th pair. In folders
    ``forward`` and ``backward`` there may be the flow from frame k + 1 to k of each pair too. Flow is that of
    the images as they are: where these are undistorted as they are read, so are its vectors.

    Parameters
    ----------
    label : str
        Which flow this is, such as ``raft-things``: all that a model file records.
    path : Path, optional
        Folder of a sequence's files, or of folders named as the sequences; or the one file of a pair.
    back : Path, optional
        File of the pair's backward flow, where `path` is a file.
    png : str, optional
        Coding of PNG files that do not tell it themselves.
    lens : Lens, optional
        Lens that was removed from the images: both ends of every vector are moved with them.

    Raises
    ------
    ModelError
        If the label has other characters than letters, digits and ``. _ -``.
    """

    name: ClassVar[str] = "flow-files"
    label: str
    path: Path | None = field(default=None, metadata=NOT_RECORDED)
    back: Path | None = field(default=None, metadata=NOT_RECORDED)
    png: str | None = field(default=None, metadata=NOT_RECORDED)
    lens: Lens | None = field(default=None, metadata=NOT_RECORDED)

    def __post_init__(self) -> None:
        if not (isinstance(self.label, str) and LABEL.fullmatch(self.label)):
            raise ModelError(f"a label of flow files has letters, digits and . _ - only, not {self.label!r}")

    def for_pair(self, sequence: ImageSequence, k: int) -> FlowFiles:
        """Return the method that reads the file of frames k and k + 1.

        Raises
        ------
        DataError
            If there is not one file for each pair of the sequence.
        """
        path = self._path()
        own = path / sequence.name.rsplit("/", 1)[-1]
        pairs = len(sequence) - 1
        of = f"{pairs + 1} images of {sequence.name}"
        bound = self._bound(own if own.is_dir() else path, pairs, k, of)
        return replace(bound, lens=removed_lens(sequence))

    def backward(self) -> FlowFiles:
        """Return the method that reads the backward flow of the pair.

        Raises
        ------
        DataError
            If there is none.
        """
        bound = self._of_two_images()
        if bound.back is None:
            raise DataError(
                f"{bound.path}: flow files without backward flow, which this model needs "
                "(one folder `forward` and one `backward` hold both)"
            )
        return replace(bound, path=bound.back, back=bound.path)

    def dense(self, previous: Image, current: Image) -> NDArray[np.float32]:
        """Flow (H, W, 2) [px] of every pixel, as the file says; NaN where unknown.

        Raises
        ------
        DataError
            If the file cannot be read, or is not of the images' size.
        """
        check_pair(previous, current)
        path = self._of_two_images()._path()
        flow = read_flow(path, self.png)
        if flow.shape[:2] != previous.shape:
            sizes = f"{flow.shape[1]}x{flow.shape[0]} for images of {previous.shape[1]}x{previous.shape[0]}"
            raise DataError(f"{path}: flow of {sizes}")
        return as_dense(flow if self.lens is None else self.lens.straighten_flow(flow))

    def _path(self) -> Path:
        if self.path is None:
            raise DataError(f"flow files {self.label!r}: it is not said where they are")
        if not self.path.exists():
            raise DataError(f"{self.path}: no such file or folder of flow")
        return self.path

    def _of_two_images(self) -> FlowFiles:
        """Return this, or the only file of its folder."""
        return self._bound(self._path(), 1, 0, "two images alone")

    def _bound(self, path: Path, pairs: int, k: int, of: str) -> FlowFiles:
        """Return the method of file k of a folder; a file is the only one."""
        if path.is_file() and pairs == 1:
            return self
        forward = [path] if path.is_file() else _files(path / "forward") or _files(path)
        back = _files(path / "backward")
        for files in (forward, back) if back else (forward,):
            if len(files) != pairs:
                where = files[0].parent if files else path
                raise DataError(f"{where}: {len(files)} flow files, but {of} need {pairs}, one for each pair")
            _check_gaps(files)
        return replace(self, path=forward[k], back=back[k] if back else None)


def coded(method: FlowMethod, png: str | None) -> FlowMethod:
    """Return the method with the coding of its PNG files said; one that reads no files stays as it is.

    Raises
    ------
    DataError
        If the coding is unknown.
    """
    if png is None:
        return method
    check_coding(png)
    return replace(method, png=png) if isinstance(method, FlowFiles) else method


def _files(folder: Path) -> list[Path]:
    """Flow files of a folder, if there is one, by name with numbers in it by value: 2 comes before 10."""
    if not folder.is_dir():
        return []
    found = [path for path in folder.iterdir() if path.suffix.lower() in (*SUFFIXES, HDF5) and path.is_file()]
    return in_order(found)


def _check_gaps(files: list[Path]) -> None:
    """Refuse files in order some of whose numbers are missing: those after a gap are not of their pairs.

    Raises
    ------
    DataError
        If numbers advance in even steps, and somewhere by several (`flowlik.datasets.naming.places`).
    """
    gaps = np.flatnonzero(np.diff(places(files)) > 1)
    if len(gaps):
        first, second = (files[gaps[0] + i].name for i in (0, 1))
        raise DataError(f"{files[0].parent}: flow files are missing between {first} and {second}")
