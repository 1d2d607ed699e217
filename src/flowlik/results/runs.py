"""Run folders: what every command leaves, and from which its report is drawn."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from numpy.typing import ArrayLike

from flowlik.errors import DataError
from flowlik.results.records import Record, write_records
from flowlik.support.files import read_json, write_json, write_npz
from flowlik.support.versions import versions

FINISHED, UNFINISHED = "run.json", "unfinished.json"


@dataclass
class RunFolder:
    """A folder with ``run.json``, ``metrics.json``, ``data/`` and what the command itself leaves.

    Results collect here and are written by `finish`. Until then ``unfinished.json`` stands for ``run.json``,
    so that an interrupted run can be repeated in the same folder, and an earlier run is kept until the
    first result of the new one is written.

    Parameters
    ----------
    path : Path
        Folder; made if missing.
    command : str
        Command line that repeats the run, without paths of one machine where possible.
    config : dict
        Resolved configuration.
    seed : int or None
        Seed of everything random.

    Raises
    ------
    DataError
        If the folder holds something other than an earlier run of the same command.
    """

    path: Path
    command: str
    config: dict[str, Any]
    seed: int | None = None
    records: list[Record] = field(default_factory=list)
    warnings: list[str] = field(default_factory=list)
    _written: set[Path] = field(default_factory=set)
    _begun: bool = False
    _at_end: list[Callable[[], object]] = field(default_factory=list)

    def __post_init__(self) -> None:
        self.path = Path(self.path)
        if self.path.is_file():
            raise DataError(f"{self.path}: is a file; give a folder to --out")
        if self.path.is_dir() and any(self.path.iterdir()):
            markers = [self.path / name for name in (FINISHED, UNFINISHED)]
            earlier = next((read_json(marker) for marker in markers if marker.is_file()), None)
            if not isinstance(earlier, dict) or earlier.get("name") != self.name:
                raise DataError(f"{self.path}: holds something else; choose another --out or empty it")

    @property
    def name(self) -> str:
        """The command's own name: its first two words."""
        return " ".join(self.command.split()[:2])

    def begin(self) -> Path:
        """Mark the folder as an unfinished run, before anything is written to it; return its path."""
        if not self._begun:
            write_json(self.path / UNFINISHED, {"name": self.name, "command": self.command})
            (self.path / FINISHED).unlink(missing_ok=True)
            self._begun = True
        return self.path

    def save(self, kind: str, label: str, arrays: Mapping[str, ArrayLike]) -> None:
        """Write the arrays of one figure to ``data/<kind>--<label>.npz``.

        Raises
        ------
        DataError
            If the place cannot be written to.
        """
        path = self.begin() / "data" / f"{kind}--{label}.npz"
        write_npz(path, arrays)
        self._written.add(path)

    def warn(self, message: str) -> None:
        """Keep a warning for report and command line, once."""
        if message not in self.warnings:
            self.warnings.append(message)

    def at_end(self, action: Callable[[], object]) -> None:
        """Do something once the run is finished, such as to delete what only an interrupted one needs."""
        self._at_end.append(action)

    def finish(self) -> Path:
        """Write metrics and ``run.json``, and return the folder: `flowlik.report.build` makes its page."""
        self.begin()
        for stale in set((self.path / "data").glob("*.npz")) - self._written:
            stale.unlink()
        write_records(self.path / "metrics.json", self.records)
        description = {
            "name": self.name,
            "command": self.command,
            "config": self.config,
            "seed": self.seed,
            "versions": versions(),
            "warnings": self.warnings,
        }
        write_json(self.path / FINISHED, description)
        (self.path / UNFINISHED).unlink()
        for action in self._at_end:
            action()
        return self.path
