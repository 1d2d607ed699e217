"""The page of a run: one HTML file that holds everything it shows."""

from __future__ import annotations

import base64
import json
from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path
from typing import Any
from urllib.parse import quote

from jinja2 import Environment, PackageLoader, StrictUndefined
from numpy.typing import NDArray

from flowlik.errors import DataError
from flowlik.report._figures import caption, render
from flowlik.report._kinds import FIGURES
from flowlik.report._style import Rendered
from flowlik.report._tables import display_name, headlines, tables
from flowlik.results.records import Record, read_records
from flowlik.support.files import atomic_write, read_json, read_npz

FLOWS = ("farneback", "lucas-kanade")
PAGE = "report.html"


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
    """One figure as the page shows it; links are relative to the page."""

    title: str
    subtitle: str
    caption: str
    source: str
    png: str
    svg: str


def write_report(folder: Path) -> Path:
    """Draw a run's figures and write its page; see :func:`flowlik.report.build`.

    Raises
    ------
    DataError
        If it is not the folder of a run, a file in it is damaged, or the place cannot be written to.
    """
    run = read_run(folder)
    sections: dict[str, list[tuple[int, Picture]]] = {}
    skipped = []
    for path in sorted((folder / "data").glob("*.npz")):
        kind, _, label = path.stem.partition("--")
        if kind not in FIGURES:
            skipped.append(f"data/{path.name} is of no known kind of figure and was not drawn")
            continue
        name, subtitle = _section(label, run.records)
        order = list(FIGURES).index(kind)
        sections.setdefault(name, []).append((order, _picture(folder, path, kind, subtitle)))
    ordered = [
        (name, [p for _, p in sorted(sections[name], key=lambda o: o[0])]) for name in sorted(sections)
    ]
    page = folder / PAGE
    with atomic_write(page) as file:
        file.write(_html(run, ordered, skipped))
    return page


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


def write_figure(figure: Rendered, stem: Path) -> tuple[Path, Path]:
    """Write both files of a figure, whole or not at all.

    Raises
    ------
    DataError
        If the place cannot be written to.
    """
    png, svg = (stem.with_name(f"{stem.name}.{suffix}") for suffix in ("png", "svg"))
    for path, content in ((png, figure.png), (svg, figure.svg)):
        with atomic_write(path, "wb") as file:
            file.write(content)
    return png, svg


def _section(label: str, records: Iterable[Record]) -> tuple[str, str]:
    """Heading a figure belongs under, its flow method where the label names one, and the label's rest."""
    flows = dict.fromkeys([*FLOWS, *(r.flow for r in records if r.flow)])
    # The longest name wins, so that `farneback-fine` is not taken for `farneback`.
    for flow in sorted(flows, key=len, reverse=True):
        if flow in label:
            return flow, label.replace(flow, "").strip("-_ ")
    return label, ""


def _picture(folder: Path, path: Path, kind: str, subtitle: str) -> Picture:
    data = read_arrays(path)
    try:
        rendered = render(kind, data)
    except DataError as error:
        raise DataError(f"{path}: {error}") from error
    write_figure(rendered, folder / "figures" / path.stem)
    link = f"figures/{quote(path.stem)}"
    return Picture(
        title=FIGURES[kind].title,
        subtitle=subtitle,
        caption=caption(kind, data),
        source=_data_uri(rendered),
        png=f"{link}.png",
        svg=f"{link}.svg",
    )


def _data_uri(figure: Rendered) -> str:
    """Embed the smaller file: line figures stay sharp at any size, images stay small."""
    kind, content = min(("svg+xml", figure.svg), ("png", figure.png), key=lambda pair: len(pair[1]))
    return f"data:image/{kind};base64,{base64.b64encode(content).decode()}"


def _html(run: Run, sections: list[tuple[str, list[Picture]]], skipped: list[str]) -> str:
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
        headlines=headlines(run.records, run.info["config"]),
        tables=tables(run.records),
        sections=[(display_name(name), pictures) for name, pictures in sections],
    )
