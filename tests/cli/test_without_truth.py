"""What `flowlik calibrate --without-truth` refuses, in one line."""

import pytest

from tests.cli.call import call, refuse


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (("--residual", "epipolar"), "--residual says how to calibrate without truth: give --without-truth"),
        (("--without-truth", "--schedule", "texture"), "--schedule needs true flow"),
        (("--without-truth", "--residual", "nonsense"), "unknown residual 'nonsense'"),
        (("--without-truth", "--self-calibrate", "--residual", "depth"), "where depth is unknown"),
        (("--without-truth", "--model", "dis"), "dis: is for the flow"),
    ],
)  # fmt: skip
def test_what_cannot_be_is_refused(flight, out, words, message):
    refuse("calibrate", flight, "--method", "lucas-kanade", *words, out=out, message=message)


def test_nine_frames_are_refused_with_the_numbers(flight, out):
    words = ("--method", "lucas-kanade", "--without-truth", "--residual", "epipolar")
    outcome = call("calibrate", flight, *words, "--out", out)
    assert outcome.code == 2
    assert outcome.err[-1].startswith("flowlik: too little to calibrate on without truth: of 8 image pairs ")
    assert not (out / "models").exists()
