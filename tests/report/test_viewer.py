"""The rerun viewer: what is recorded, live and into a file."""

import signal
import socket
import subprocess
import sys
import time

import numpy as np
import pytest

from flowlik.errors import DataError
from flowlik.odometry.odometry import Odometry
from flowlik.report.viewer import _ellipses, _ellipsoid, _NoViewer, _RerunViewer, viewer, watched_by
from tests.helpers import CAMERA


def test_ellipses_have_the_half_widths_as_axes():
    angle = 0.4
    R = np.array([[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]])
    (outline,) = _ellipses(np.array([[10.0, 20.0]]), np.array([[3.0, 7.0]]), R[None])
    local = (outline - [10, 20]) @ R
    np.testing.assert_allclose((local[:, 0] / 3) ** 2 + (local[:, 1] / 7) ** 2, 1)
    np.testing.assert_allclose(outline[0], outline[-1])


def test_an_ellipsoid_holds_nine_tenths():
    rng = np.random.default_rng(0)
    root = rng.standard_normal((3, 3))
    half_axes, R = _ellipsoid(root @ root.T)
    assert np.linalg.det(R) == pytest.approx(1)
    samples = rng.standard_normal((20_000, 3)) @ root.T
    inside = (((samples @ R) / half_axes) ** 2).sum(axis=1) <= 1
    assert inside.mean() == pytest.approx(0.9, abs=0.01)


def test_no_viewer_costs_nothing():
    assert isinstance(viewer(False, None), _NoViewer)
    assert list(watched_by(_NoViewer(), iter([]), None, None)) == []


class Still:
    """Two frames of noise."""

    def timestamp(self, k):
        return 0.1 * k

    def image(self, k):
        return np.random.default_rng(0).integers(0, 255, (CAMERA.height, CAMERA.width), np.uint8)


def shown(view):
    """An odometry's two steps shown."""
    from flowlik.egomotion import ransac
    from flowlik.flow import flow_method

    sequence = Still()
    robot = Odometry(CAMERA, flow_method("lucas-kanade"), ransac())
    robot.step(sequence.image(0), 0.0)
    motion = robot.step(np.roll(sequence.image(0), 1, axis=1), 0.1)
    assert list(watched_by(view, [motion], sequence, robot)) == [motion]


def entities(path):
    """What a recording holds, by rerun's own tool."""
    words = [sys.executable, "-m", "rerun", "rrd", "print", str(path)]
    return subprocess.run(words, capture_output=True, text=True, check=True).stdout


SHOWN = ["/image/flow", "/image/error", "/image/inliers", "/world/camera", "/world/trajectory"]


def test_a_recording_holds_all_that_is_shown(tmp_path):
    pytest.importorskip("rerun")
    path = tmp_path / "run" / "view.rrd"
    shown(viewer(False, path))
    listed = entities(path)
    for entity in [*SHOWN, "/world/covariance"]:
        assert entity in listed
    with pytest.raises(DataError, match="cannot be opened"):
        viewer(False, path / "x")


def test_live_and_recorded_at_once(tmp_path):
    """A viewer without a window receives what the file holds."""
    pytest.importorskip("rerun")
    with socket.socket() as free:
        free.bind(("127.0.0.1", 0))
        port = free.getsockname()[1]
    received = tmp_path / "received.rrd"
    words = [
        sys.executable,
        "-m",
        "rerun",
        "--save",
        str(received),
        "--port",
        str(port),
        "--bind",
        "127.0.0.1",
    ]
    with subprocess.Popen(words, stderr=subprocess.DEVNULL, stdout=subprocess.DEVNULL) as server:
        try:
            for _ in range(100):
                with socket.socket() as probe:
                    if probe.connect_ex(("127.0.0.1", port)) == 0:
                        break
                time.sleep(0.1)
            shown(_RerunViewer(True, tmp_path / "view.rrd", f"rerun+http://127.0.0.1:{port}/proxy"))
            time.sleep(0.5)
        finally:
            server.send_signal(signal.SIGINT)
            server.wait(10)
    for path in (received, tmp_path / "view.rrd"):
        assert all(entity in entities(path) for entity in SHOWN)
