import json
import shutil
from pathlib import Path

import cv2
import numpy as np
import pytest

from tests.cli.call import succeed
from tests.commands.quick import quick

__all__ = ["quick"]

METHODS = ("lucas-kanade", "farneback")


@pytest.fixture(scope="package")
def flight(quick, tmp_path_factory) -> Path:
    """Simulated data set of nine small images."""
    folder = tmp_path_factory.mktemp("data") / "flight"
    succeed("simulate", "planes", "--trajectory", "training", "--frames", 9, "--width", 96, "--height", 64,
            "--out", folder)  # fmt: skip
    return folder


@pytest.fixture(scope="package")
def calibrations(flight, tmp_path_factory) -> dict[str, Path]:
    """Run folders of the calibration of both methods."""
    folder = tmp_path_factory.mktemp("calibrations")
    for method in METHODS:
        succeed("calibrate", flight, "--method", method, "--out", folder / method)
    return {method: folder / method for method in METHODS}


@pytest.fixture(scope="package")
def models(calibrations) -> dict[str, Path]:
    """Model files of both methods."""
    return {method: run / "models" / f"{method}.json" for method, run in calibrations.items()}


@pytest.fixture
def undrawn(monkeypatch):
    """Runs without figures and page, which take most of a small run's time."""
    monkeypatch.setattr("flowlik.report.build", lambda run, **_: run / "report.html")


@pytest.fixture
def out(tmp_path) -> Path:
    """Folder of a run that is not there yet."""
    return Path(tmp_path / "out")


@pytest.fixture
def copy(flight, tmp_path) -> Path:
    """A copy of the data set to damage."""
    return Path(shutil.copytree(flight, tmp_path / "copy"))


@pytest.fixture
def edited(models, tmp_path):
    """Write a changed copy of the Lucas-Kanade model: a function of a function that changes its JSON."""

    def edit(change) -> Path:
        content = json.loads(models["lucas-kanade"].read_text())
        change(content)
        path = tmp_path / "edited.json"
        path.write_text(json.dumps(content))
        return path

    return edit


def image_of(folder: Path, k: int) -> Path:
    """Image file k of the simulated data set."""
    return folder / "image_lcam_front" / f"{k:06d}_lcam_front.png"


def blank_images(folder: Path) -> None:
    """Replace all images by grey ones."""
    for path in (folder / "image_lcam_front").iterdir():
        cv2.imwrite(str(path), np.full((64, 96, 3), 120, np.uint8))
