"""The page of a run: what it answers first, and all else folded, with its figures as files beside it."""

from __future__ import annotations

import json
from collections.abc import Callable, Iterable
from dataclasses import dataclass
from pathlib import Path
from typing import Any
from urllib.parse import quote

from jinja2 import Environment, PackageLoader, StrictUndefined
from numpy.typing import NDArray

from flowlik.errors import DataError
from flowlik.report._draw_front import draw_front_bars, draw_front_coverage
from flowlik.report._figures import caption, render
from flowlik.report._kinds import FIGURES
from flowlik.report._style import Rendered, render_with
from flowlik.report._tables import tables
from flowlik.report.names import data_name, name_of
from flowlik.report.verdict import GLOSSARY, Verdict, verdict_of
from flowlik.results.records import Record, read_records
from flowlik.support.files import atomic_write, read_json, read_npz

FLOWS = ("farneback", "lucas-kanade")
PAGE = "report.html"
FRONT_KINDS = (
    "uncertainty", "trajectories", "innovations", "frame-errors", "gauntlet", "error-over-texture",
    "segment-errors", "goodness",
)  # fmt: skip
"""Kinds that may stand at the head of the page, the first that a run has."""
BARS = (
    "Each cross is the {confidence:.0%} interval of one vector, magnified. Small: known. One long bar: an "
    "edge, known across and not along."
)
CURVES = "On the dashed line a model is honest. Bold: mean; pale: each flow and data set."
MARKS = {"good": "●", "fair": "▲", "poor": "■", "": ""}


@dataclass(frozen=True)
class Run:
    """What a run folder says of itself.

    Parameters
    ----------
    folder : Path
        The run folder.
    info : dict
        Contents of ``run.json``: command, config, versions, seed, warnings.
    records : list of Record
        Contents of ``metrics.json``.
    """

    folder: Path
    info: dict[str, Any]
    records: list[Record]


@dataclass(frozen=True)
class Picture:
    """One figure as the page shows it; the link is relative to the page."""

    title: str
    data: str
    caption: str
    png: str


def write_report(folder: Path, svg: bool = False, map: Callable[..., Iterable[Any]] = map) -> Path:
    """Draw a run's figures and write its page; see :func:`flowlik.report.build`.

    Raises
    ------
    DataError
        If it is not the folder of a run, a file in it is damaged, or the place cannot be written to.
    """
    run = read_run(folder)
    sections: dict[str, list[tuple[int, Picture]]] = {}
    skipped = []
    paths = sorted((folder / "data").glob("*.npz"))
    drawn = []
    for path in paths:
        kind, _, label = path.stem.partition("--")
        if kind not in FIGURES:
            skipped.append(f"data/{path.name} is of no known kind of figure and was not drawn")
            continue
        drawn.append((path, kind, *_section(label, run.records)))
    arguments = [(folder, path, kind, rest, svg) for path, kind, _, rest in drawn]
    pictures = map(_picture, *zip(*arguments)) if arguments else ()
    for (_, kind, name, _), picture in zip(drawn, pictures):
        sections.setdefault(name, []).append((list(FIGURES).index(kind), picture))
    ordered = [
        (name, [p for _, p in sorted(sections[name], key=lambda o: o[0])]) for name in sorted(sections)
    ]
    verdict = verdict_of(run.records, run.info["command"])
    front = _front(folder, paths, verdict)
    _remove_stale(folder, [path.stem for path in paths] + [picture.stem for picture in front.files], svg)
    page = folder / PAGE
    with atomic_write(page) as file:
        file.write(_html(run, verdict, front, ordered, skipped))
    return page


@dataclass(frozen=True)
class Front:
    """Pictures at the head of the page: of what, and what they show."""

    pictures: tuple[Picture, ...] = ()
    files: tuple[Path, ...] = ()


def _front(folder: Path, paths: list[Path], verdict: Verdict) -> Front:
    """At most two pictures: what the run is about, and what its intervals hold."""
    chosen = [
        path for kind in FRONT_KINDS for path in paths if path.stem.partition("--")[0] == kind
    ][: 1 if verdict.coverage else 2]  # fmt: skip
    pictures, files = [], []
    for path in chosen:
        kind, _, label = path.stem.partition("--")
        arrays, title, link = read_arrays(path), FIGURES[kind].title, path.stem
        text = ""
        if kind == "uncertainty":
            link, text = f"front-{path.stem}", BARS.format(confidence=float(arrays["confidence"]))
            files.append(folder / "figures" / f"{link}.png")
            _write_png(render_with(draw_front_bars, arrays).png, files[-1])
        flow, rest = _section(label, [])
        about = ", ".join(filter(None, (name_of(flow), data_name(rest))))
        pictures.append(Picture(title, about, text, f"figures/{quote(link)}.png"))
    if verdict.coverage:
        files.append(folder / "figures" / "front-coverage.png")
        _write_png(render_with(draw_front_coverage, verdict.coverage).png, files[-1])
        where = "the data calibrated on (in sample)" if verdict.in_sample else "data not calibrated on"
        pictures.append(Picture("What the intervals hold", where, CURVES, "figures/front-coverage.png"))
    return Front(tuple(pictures), tuple(files))


def _write_png(content: bytes, path: Path) -> None:
    with atomic_write(path, "wb") as file:
        file.write(content)


def _remove_stale(folder: Path, stems: list[str], svg: bool) -> None:
    """Remove figures of an earlier page of this run that this one does not have."""
    for path in (folder / "figures").glob("*.*"):
        if path.suffix in (".png", ".svg") and (
            path.stem not in stems or (path.suffix == ".svg" and not svg)
        ):
            path.unlink()


def read_run(folder: Path) -> Run:
    """Read ``run.json`` and ``metrics.json`` of a run folder.

    Parameters
    ----------
    folder : Path
        The run folder.

    Returns
    -------
    Run
        Its contents, keys that ``run.json`` leaves out being empty.

    Raises
    ------
    DataError
        If the folder or either file is missing or invalid.
    """
    if not folder.is_dir():
        raise DataError(f"{folder}: no such run folder")
    if not (folder / "run.json").is_file():
        raise DataError(f"{folder}: not a run folder, it has no run.json")
    info = read_json(folder / "run.json")
    defaults: dict[str, Any] = {"command": "", "config": {}, "versions": {}, "seed": None, "warnings": []}
    if not isinstance(info, dict):
        raise DataError(f"{folder / 'run.json'}: expected an object with {', '.join(defaults)}")
    info = defaults | info
    wrong = [k for k, v in defaults.items() if v is not None and not isinstance(info[k], type(v))]
    if wrong or not all(isinstance(w, str) for w in info["warnings"]):
        raise DataError(
            f"{folder / 'run.json'}: {wrong[0] if wrong else 'warnings'} is not of the expected type"
        )
    return Run(folder, info, read_records(folder / "metrics.json"))


def read_arrays(path: Path) -> dict[str, NDArray[Any]]:
    """Read the arrays of an npz file, refusing pickled objects.

    Raises
    ------
    DataError
        If the file is missing or not a valid npz of plain arrays.
    """
    return read_npz(path)


def write_figure(figure: Rendered, stem: Path) -> list[Path]:
    """Write the files of a figure, whole or not at all.

    Raises
    ------
    DataError
        If the place cannot be written to.
    """
    written = []
    for suffix, content in (("png", figure.png), ("svg", figure.svg)):
        if content:
            written.append(stem.with_name(f"{stem.name}.{suffix}"))
            _write_png(content, written[-1])
    return written


def _section(label: str, records: Iterable[Record]) -> tuple[str, str]:
    """Heading a figure belongs under, its flow method where the label names one, and the label's rest."""
    flows = dict.fromkeys([*FLOWS, *(r.flow for r in records if r.flow)])
    # The longest name wins, so that `farneback-fine` is not taken for `farneback`.
    for flow in sorted(flows, key=len, reverse=True):
        if flow in label:
            return flow, label.replace(flow, "").strip("-_ ")
    return label, ""


def _picture(folder: Path, path: Path, kind: str, rest: str, svg: bool) -> Picture:
    data = read_arrays(path)
    try:
        rendered = render(kind, data, svg)
    except DataError as error:
        raise DataError(f"{path}: {error}") from error
    write_figure(rendered, folder / "figures" / path.stem)
    link = f"figures/{quote(path.stem)}.png"
    return Picture(FIGURES[kind].title, data_name(rest), caption(kind, data), link)


def _html(
    run: Run, verdict: Verdict, front: Front, sections: list[tuple[str, list[Picture]]], skipped: list[str]
) -> str:
    environment = Environment(
        loader=PackageLoader("flowlik.report"),
        autoescape=True,
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )
    return environment.get_template("page.html").render(
        info=run.info,
        config=json.dumps(run.info["config"], indent=2, ensure_ascii=False) if run.info["config"] else "",
        warnings=run.info["warnings"] + skipped,
        verdict=verdict,
        marks=MARKS,
        front=front.pictures,
        glossary=GLOSSARY if verdict.coverage else {},
        tables=tables(run.records),
        sections=[(name_of(name) if name else "Figures", pictures) for name, pictures in sections],
    )
