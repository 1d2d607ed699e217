"""A camera while it films: motion JPEG over HTTP, served here."""

import threading
import time
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from itertools import count

import cv2
import pytest

from flowlik.datasets import open_sequence
from flowlik.datasets.live import Live, live_address
from flowlik.errors import DataError
from flowlik.results.records import read_records, select
from tests.cli.call import refuse, succeed

FRAMES = 12


@pytest.fixture(scope="module")
def stream(flight):
    """Address of a stream of a flight's images, fifteen a second, to and fro."""
    sequence = open_sequence(flight)
    pictures = [cv2.imencode(".jpg", sequence.image(k))[1].tobytes() for k in range(len(sequence))]
    pictures += pictures[-2:0:-1]

    class Camera(BaseHTTPRequestHandler):
        def do_GET(self):
            self.send_response(200)
            self.send_header("Content-Type", "multipart/x-mixed-replace; boundary=frame")
            self.end_headers()
            for k in count():
                picture = pictures[k % len(pictures)]
                head = f"--frame\r\nContent-Type: image/jpeg\r\nContent-Length: {len(picture)}\r\n\r\n"
                try:
                    self.wfile.write(head.encode() + picture + b"\r\n")
                except OSError:
                    return
                time.sleep(1 / 15)

        def log_message(self, *args):
            pass

    server = ThreadingHTTPServer(("127.0.0.1", 0), Camera)
    threading.Thread(target=server.serve_forever, daemon=True).start()
    yield f"http://127.0.0.1:{server.server_port}/stream.mjpg"
    server.shutdown()


def test_frames_come_in_order_and_time_advances(stream):
    with Live(stream, "60,48,32") as camera:
        first = camera.image(0)
        assert first.shape == camera.shape and (camera.camera.width, len(camera)) == (first.shape[1], 1)
        assert camera.more() and camera.more()
        assert len(camera) == 3 and camera.timestamp(2) > camera.timestamp(1) > camera.timestamp(0)
        with pytest.raises(DataError, match="frame 1 is gone"):
            camera.image(1)
    assert not camera.more()


def test_a_slow_reader_gets_the_newest_frame(stream):
    with Live(stream) as camera:
        time.sleep(0.5)
        assert camera.more() and camera.dropped >= 3
        assert time.time() - camera.timestamp(1) < 0.3


@pytest.mark.usefixtures("undrawn")
def test_its_trajectory_is_written_at_the_end(stream, tmp_path):
    words = ("--camera", "60,48,32", "--model", "lucas-kanade", "--frames", FRAMES, "--out", tmp_path / "run")
    succeed("odometry", stream, *words)
    rows = (tmp_path / "run/trajectory_tum.txt").read_text().splitlines()
    times = [float(row.split()[0]) for row in rows if not row.startswith("#")]
    assert len(times) == FRAMES and times == sorted(times) and abs(times[-1] - time.time()) < 300
    records = read_records(tmp_path / "run/metrics.json")
    assert "timestamps=receipt" in select(records, metric="frames_per_second")[0].protocol


@pytest.mark.parametrize(
    ("words", "said"),
    [
        ((), "a live camera needs --camera"),
        (("--camera", "60,48,32", "--stride", 2), "--stride is for recordings"),
        (("--camera", "60,48,32", "--fps", 30), "--fps is for recordings"),
        (("--camera", "60,48,32", "--scale", "truth-norm"), "--scale truth-norm is for recordings"),
        (("--camera", "60,48,32", "--residual", "depth"), "has no depth"),
        (("--camera", "60,48,32"), "cannot be opened"),
    ],
)
def test_what_a_camera_that_films_cannot_have_is_refused(words, said, out):
    refuse("odometry", "/dev/video97", *words, "--model", "lucas-kanade", out=out, message=said)


def test_addresses_are_told_from_files():
    assert live_address("rtsp:/host:554/a") == live_address("rtsp://host:554/a") == "rtsp://host:554/a"
    assert live_address("/dev/video0") == "/dev/video0"
    assert live_address("walk.mp4") is None and live_address("http") is None
