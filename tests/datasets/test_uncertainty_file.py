import cv2
import numpy as np
import pytest

from flowlik.datasets.uncertainty_file import read_uncertainty, write_uncertainty
from flowlik.errors import DataError


def test_round_trip(tmp_path):
    rng = np.random.default_rng(0)
    half_width = rng.uniform(0.01, 200, (7, 9, 2))
    angle = rng.uniform(-np.pi, np.pi, (7, 9))
    half_width[2, 3], angle[2, 3] = np.nan, np.nan
    half_width[0, 0] = [1e-9, 1e9]
    write_uncertainty(tmp_path / "u.png", half_width, angle)
    read = read_uncertainty(tmp_path / "u.png")
    assert np.isnan(read.half_width_px[2, 3]).all()
    assert np.isnan(read.angle[2, 3])
    np.testing.assert_allclose(read.half_width_px[0, 0], [1 / 256, 65535 / 256])
    half_width[0, 0] = read.half_width_px[0, 0]
    np.testing.assert_allclose(read.half_width_px, half_width, atol=0.5 / 256 + 1e-12)
    difference = read.angle - angle
    turns = difference / np.pi
    np.testing.assert_allclose(turns - np.round(turns), np.where(np.isnan(turns), np.nan, 0), atol=1e-5)


def test_other_images_are_refused(tmp_path):
    cv2.imwrite(str(tmp_path / "u.png"), np.zeros((4, 5, 3), np.uint8))
    with pytest.raises(DataError, match="not an uncertainty file"):
        read_uncertainty(tmp_path / "u.png")
