"""A full disk and a folder that may not be written to: one line, and nothing half-written."""

import os
import resource
import subprocess
import sys

import pytest

from flowlik.errors import DataError
from flowlik.support.files import atomic_write, read_npz
from tests.cli.call import call, leftovers
from tests.cli.conftest import image_of

PROGRAM = """
import sys
from flowlik.cli import main
sys.argv[0] = "flowlik"
main()
"""


@pytest.mark.parametrize("error", ["ENOSPC", "EFBIG", "EROFS"])
def test_a_write_that_finds_the_disk_full(tmp_path, error):
    import errno

    number = getattr(errno, error)
    (tmp_path / "a.txt").write_text("as it was")
    with (
        pytest.raises(DataError, match=r"a\.txt: cannot be written"),
        atomic_write(tmp_path / "a.txt") as file,
    ):
        file.write("begun")
        raise OSError(number, os.strerror(number))
    assert [p.name for p in tmp_path.iterdir()] == ["a.txt"]
    assert (tmp_path / "a.txt").read_text() == "as it was"


@pytest.mark.parametrize("command", ["flow", "simulate"])
def test_a_command_on_a_full_disk(flight, tmp_path, command):
    """The system refuses files of more than 4 kB, as a full disk would."""
    words = {
        "flow": ("flow", image_of(flight, 0), image_of(flight, 1), "--model", "farneback"),
        "simulate": ("simulate", "planes", "--frames", 3, "--width", 96, "--height", 64),
    }[command]

    def limit():
        resource.setrlimit(resource.RLIMIT_FSIZE, (4096, 4096))

    # what numba would compile it could not cache either
    environment = {**os.environ, "PYTHONPATH": os.pathsep.join(sys.path), "PYTHONDONTWRITEBYTECODE": "1"}
    ended = subprocess.run(
        [sys.executable, "-c", PROGRAM, *map(str, words), "--out", str(tmp_path / "out")],
        capture_output=True, text=True, preexec_fn=limit, env=environment,
    )  # fmt: skip
    lines = [line for line in ended.stderr.splitlines() if line.startswith("flowlik: ")]
    assert (ended.returncode, len(lines)) == (2, 1), ended.stderr
    assert "cannot be written (File too large)" in lines[0]
    assert "Traceback" not in ended.stderr
    assert not leftovers(tmp_path)


def test_a_place_that_cannot_be_written_to(flight, tmp_path):
    """Below a file no folder can be made, whoever asks."""
    (tmp_path / "file").write_text("")
    for words in (
        ("flow", image_of(flight, 0), image_of(flight, 1), "--model", "farneback"),
        ("simulate", "planes", "--frames", 3, "--width", 96, "--height", 64),
        ("odometry", flight, "--estimator", "ransac", "--frames", 3),
    ):
        outcome = call(*words, "--out", tmp_path / "file" / "run")
        assert outcome.code == 2, outcome
        assert len(outcome.err) == 1
        assert "file" in outcome.err[0]


@pytest.mark.parametrize("error", ["EACCES", "EROFS"])
def test_a_folder_that_refuses_to_be_written_to(flight, tmp_path, monkeypatch, error):
    """As a read-only folder does, told to the superuser too, whom permissions do not stop."""
    import errno
    from pathlib import Path

    locked, honest = tmp_path / "locked", Path.mkdir
    locked.mkdir()

    def mkdir(path, *words, **more):
        if locked in path.parents:
            number = getattr(errno, error)
            raise OSError(number, os.strerror(number), str(path))
        honest(path, *words, **more)

    monkeypatch.setattr(Path, "mkdir", mkdir)
    for words in (
        ("flow", image_of(flight, 0), image_of(flight, 1), "--model", "farneback"),
        ("simulate", "planes", "--frames", 3, "--width", 96, "--height", 64),
        ("odometry", flight, "--estimator", "ransac", "--frames", 3),
    ):
        outcome = call(*words, "--out", locked / "run")
        assert outcome.code == 2
        assert "cannot be written" in outcome.err[0]
        assert not list(locked.iterdir())


@pytest.mark.skipif(os.geteuid() == 0, reason="the superuser may write anywhere")
def test_a_read_only_folder(flight, tmp_path):
    (tmp_path / "locked").mkdir(mode=0o500)
    outcome = call("flow", image_of(flight, 0), image_of(flight, 1), "--model", "farneback",
                   "--out", tmp_path / "locked" / "run")  # fmt: skip
    assert outcome.code == 2
    assert "cannot be written" in outcome.err[0]


def test_an_npz_that_claims_too_much(tmp_path, monkeypatch):
    import zipfile

    import numpy as np

    header = (
        b"\x93NUMPY\x01\x00v\x00" + b"{'descr': '<f8', 'fortran_order': False, 'shape': (1000000000000,), }"
    )
    with zipfile.ZipFile(tmp_path / "a.npz", "w") as archive:
        archive.writestr("a.npy", header.ljust(127) + b"\n")
    with pytest.raises(DataError, match="not a readable npz file"):
        read_npz(tmp_path / "a.npz")
    monkeypatch.setattr("flowlik.support.files.MAX_NPZ_BYTES", 2**20)
    np.savez_compressed(tmp_path / "b.npz", a=np.zeros(2**18))
    with pytest.raises(DataError, match="claims more than 1 MiB"):
        read_npz(tmp_path / "b.npz")
    np.savez(tmp_path / "c.npz", a=np.array([{}], dtype=object))
    with pytest.raises(DataError, match="not a readable npz file"):
        read_npz(tmp_path / "c.npz")
