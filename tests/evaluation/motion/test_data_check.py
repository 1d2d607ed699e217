import numpy as np
import pytest
from scipy.spatial.transform import RigidTransform

from flowlik.evaluation.motion import Agreement, agreement, disagreement_warning
from flowlik.evaluation.motion._data_check import _disagreeing
from tests.helpers import CAMERA, lcm_likelihood, make_scene, random_motion


def test_a_true_motion_agrees_and_another_does_not():
    rng = np.random.default_rng(0)
    motion, other = random_motion(rng, 1.0, 0.5), random_motion(rng, 4.0, 0.5)
    m = make_scene(motion, rng, n=200, likelihood=lcm_likelihood()).measurements
    good, bad = (agreement(m, CAMERA, truth, motion) for truth in (motion, other))
    assert good.truth_px == good.found_px < 1.0
    assert bad.truth_px > 5.0
    assert _disagreeing([good, bad, good]).tolist() == [1]


def test_a_standstill_says_nothing():
    rng, still = np.random.default_rng(1), RigidTransform.identity()
    m = make_scene(random_motion(rng), rng, n=20).measurements
    assert np.isnan(agreement(m, CAMERA, still, random_motion(rng)).truth_px)
    assert not len(_disagreeing([Agreement(np.nan, np.nan)]))
    assert not len(_disagreeing([]))


def test_the_warning_names_frames():
    pairs = [Agreement(0.4, 0.2), Agreement(9.0, 0.3), Agreement(1.9, 0.2)]
    message = disagreement_warning("kitti/00", np.array([11, 12, 13]), pairs)
    assert message is not None
    assert "kitti/00: at 1 of 3 frames" in message and "frames 12;" in message and "9.0 px" in message
    assert disagreement_warning("kitti/00", np.array([11]), pairs[:1]) is None


@pytest.mark.parametrize("splice", [None, 20])
def test_real_images_of_other_frames_are_noticed(shared_data, splice):
    """KITTI 03's own images agree with its poses; with some frames left out of the images they do not."""
    from flowlik.comparison.baselines import opencv_essential
    from flowlik.datasets import open_sequence
    from flowlik.egomotion import Epipolar
    from flowlik.flow import LucasKanade
    from flowlik.image.texture import TextureDefinition
    from flowlik.measurement.features import measure_features

    sequence, pairs = open_sequence(shared_data / "kitti_odometry" / "03"), []
    shift = 0
    for k in range(88, 92):
        shift = splice if splice and k > 89 else 0
        m = measure_features(sequence.image(k + shift), sequence.image(k + 1 + shift), LucasKanade(),
                             TextureDefinition())  # fmt: skip
        truth = sequence.T_n_c(k + 1).inv() * sequence.T_n_c(k)
        found = opencv_essential(Epipolar.of(m, sequence.camera))
        assert found is not None
        pairs.append(agreement(m, sequence.camera, truth, found))
    assert _disagreeing(pairs).tolist() == ([2, 3] if splice else [])
