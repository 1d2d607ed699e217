"""Models learned without truth: they know the law of the errors, and say what they do not know."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import RigidTransform, Rotation

from flowlik.calibration import _learn
from flowlik.egomotion import Status
from flowlik.egomotion.result import unsolved
from flowlik.errors import CalibrationError, ModelError
from flowlik.flow import LucasKanade, describe
from flowlik.likelihood.model_file import load_likelihood, save_likelihood
from flowlik.likelihood.over_time import OverTime, Persistence
from flowlik.likelihood.shared_errors import SCALES_PX, ScoreCorrelation, SharedErrors
from flowlik.self_supervision import (
    Pass,
    Reading,
    errors_against,
    learn_without_truth,
    learning,
    model_of_errors,
    shared_by,
    truthless_form,
)
from flowlik.self_supervision.passes import check_enough
from tests.helpers import lcm_likelihood, random_motion
from tests.self_supervision.scenes import SIZE_PX, seen_pair


@pytest.fixture(scope="module")
def learned():
    rng = np.random.default_rng(0)
    pairs = [seen_pair(rng, 160) for _ in range(22)]
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(learning, "ROUNDS", 1)
        patch.setattr(_learn, "ITERATIONS", 40)
        return learn_without_truth(pairs, LucasKanade(), family="laplace", provenance={"data": "synthetic"})


def test_the_law_of_the_errors_is_found(learned):
    errors = learned.last.of(learned.held_out)
    index, likelihood = learned.likelihood.schedule.index, learned.likelihood
    x = np.concatenate([e.coordinates(index) for e in errors])
    residual = np.concatenate([e.values["residual"] for e in errors])
    # along any line the magnitude of two independent Laplacian components has a median of 0.7 to 0.85;
    # below, a half's motion is as wrong as its vectors
    large = residual > 4
    ratio = likelihood.bound(x, 0.5)[large] / (SIZE_PX * residual[large])
    assert np.quantile(ratio, [0.1, 0.5, 0.9]) == pytest.approx([0.78] * 3, rel=0.4)
    reading = Reading.of(likelihood, errors)
    assert reading.coverage == pytest.approx((0.5, 0.68, 0.9, 0.95), abs=0.09)


def test_the_model_says_what_it_is(learned, tmp_path):
    save_likelihood(learned.likelihood, tmp_path / "own.json")
    again = load_likelihood(tmp_path / "own.json")
    assert again.residual == "epipolar"
    told = again.provenance
    assert (told["data"], told["start"], told["shared_by_whole_images"]) == ("synthetic", "none", "unknown")
    assert told["pairs"] + told["held_out_pairs"] == told["statuses"]["solved"] == 22
    assert not {*learned.held_out} & {*range(8)}
    assert {"in_fit_nll", "out_of_fit_nll", "out_of_fit_coverage_90"} <= again.goodness.keys()
    assert again.goodness["in_fit_nll"] < again.goodness["out_of_fit_nll"]
    m = learned.last.crossed[0].measurements
    with pytest.raises(ModelError, match="across epipolar lines"):
        again.coordinate(m)


def test_ten_frames_are_too_few():
    rng = np.random.default_rng(1)
    with pytest.raises(CalibrationError, match="of 9 image pairs 9 solved; 20 solved ones are needed"):
        learn_without_truth([seen_pair(rng, 200) for _ in range(9)], LucasKanade())


def turned(rng):
    return RigidTransform.from_rotation(Rotation.from_rotvec(rng.normal(0, 0.02, 3)))


@pytest.mark.parametrize(("motion", "status"), [("still", "still"), ("turn", "degenerate")])
def test_no_parallax_is_refused_with_the_numbers(motion, status):
    rng = np.random.default_rng(2)
    pairs = []
    for _ in range(24):
        T = RigidTransform.identity() if motion == "still" else turned(rng)
        pair = seen_pair(rng, 200, T)
        if motion == "still":
            m = replace(pair.measurements, flow=0.02 * rng.standard_normal((200, 2)))
            pair = pair._replace(measurements=m)
        pairs.append(pair)
    with pytest.raises(CalibrationError, match=f"of 24 image pairs .*{status}"):
        learn_without_truth(pairs, LucasKanade())


def test_one_plane_is_refused_with_the_numbers():
    rng = np.random.default_rng(3)

    def plane(rays):
        return 6 / (rays[:, 2] + 0.4 * rays[:, 0])

    pairs = [seen_pair(rng, 200, depth_of=plane) for _ in range(24)]
    with pytest.raises(CalibrationError, match=r"of 24 image pairs .*ambiguous"):
        learn_without_truth(pairs, LucasKanade())


def test_half_of_the_frames_unsolved_are_warned_of():
    rng = np.random.default_rng(4)
    one = errors_against(seen_pair(rng, 20).residuals(), [random_motion(rng)] * 2, ())
    halves = {
        status: (unsolved(status, ""), unsolved(Status.SOLVED, ""))
        for status in (Status.SOLVED, Status.STILL)
    }
    motions = [halves[Status.STILL if k % 2 else Status.SOLVED] for k in range(50)]
    found = Pass(motions, list(range(0, 50, 2)), [one] * 25, [one] * 25)
    (warning,) = check_enough(found)
    assert warning.startswith("of 50 image pairs 25 solved, 25 still: only the solved ones tell of errors")
    assert check_enough(Pass(motions[::2], list(range(25)), [one] * 25, [one] * 25)) == []


def test_vectors_that_are_all_alike_are_refused(monkeypatch):
    monkeypatch.setattr(_learn, "ITERATIONS", 20)
    rng = np.random.default_rng(5)
    T, names = random_motion(rng, 1.0, 0.6), truthless_form(LucasKanade(), "epipolar").covariates
    errors = []
    for _ in range(8):
        pair = seen_pair(rng, 200, T)
        m = pair.measurements
        signals = {name: np.ones_like(s) * (1 + 1e-3 * rng.random(s.shape)) for name, s in m.signals.items()}
        alike = replace(m, signals=signals, t=np.ones_like(m.t))
        errors.append(errors_against(pair._replace(measurements=alike).residuals(), (T, T), names))
    with pytest.raises(CalibrationError, match=r"alike|constant"):
        model_of_errors(errors, range(8), LucasKanade(), "laplace")


def test_what_whole_images_share_is_the_starts():
    rng = np.random.default_rng(6)
    T = random_motion(rng, 1.0, 0.6)
    errors = [
        errors_against(seen_pair(rng, 200, T, depth=True).residuals(), (T, T), ("texture",)) for _ in range(4)
    ]
    model = lcm_likelihood(method=describe(LucasKanade()))
    weights = [0.5, *np.zeros(len(SCALES_PX)), 0.1]
    correlation = ScoreCorrelation(
        np.array(SCALES_PX), *(np.array(weights) * share for share in (1.0, 0.5, 0.2))
    )
    stays = OverTime(Persistence(0.3, 1.0), Persistence(0.2, 1.0))
    start = replace(model, shared_errors=SharedErrors(correlation, over_time=stays))
    told = shared_by(model, errors, start)
    kinds = (told.correlation.isotropic, told.correlation.along, told.correlation.vertical)
    assert [kind[-1] for kind in kinds] == pytest.approx([0.1, 0.05, 0.02])
    assert told.over_time == stays
    alone = shared_by(model, errors, None)
    assert (alone.correlation.along[-1], alone.over_time) == (0.0, None)
