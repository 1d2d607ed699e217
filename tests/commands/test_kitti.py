import cv2
import pytest

from flowlik.commands import kitti_table
from flowlik.commands.options import KittiOptions
from flowlik.datasets.kitti import find_sequences
from flowlik.errors import DataError
from flowlik.flow.base import describe
from flowlik.flow.lucas_kanade import LucasKanade
from flowlik.likelihood.model_file import save_likelihood
from flowlik.results.records import read_records, select
from tests.helpers import lcm_likelihood, textured_image


@pytest.fixture(params=["official", "clips"])
def root(request, tmp_path):
    """Two sequences of three frames in KITTI's layout; the picture slides, which tells little."""
    official = request.param == "official"
    for name in ("01", "07"):
        folder = tmp_path / "kitti" / ("sequences" if official else "") / name
        (folder / "image_0").mkdir(parents=True)
        for k in range(3):
            picture = textured_image((120, 160), seed=int(name), shift=(2.0 * k, k))
            cv2.imwrite(str(folder / "image_0" / f"{k:06d}.png"), picture)
        (folder / "calib.txt").write_text("P0: 120 0 80 0 0 120 60 0 0 0 1 0\n")
        poses = tmp_path / "kitti" / "poses" / f"{name}.txt" if official else folder / "poses.txt"
        poses.parent.mkdir(exist_ok=True)
        poses.write_text("".join(f"1 0 0 {0.5 * k} 0 1 0 0 0 0 1 {k}\n" for k in range(3)))
    return tmp_path / "kitti"


@pytest.fixture
def model(tmp_path):
    path = tmp_path / "model.json"
    save_likelihood(lcm_likelihood(method=describe(LucasKanade())), path)
    return path


def test_the_table_has_all_rows_and_the_published_figures(root, model, tmp_path):
    pytest.importorskip("poselib")
    assert list(find_sequences(root)) == ["01", "07"]
    run = kitti_table(root, model, tmp_path / "run")
    records = read_records(run.path / "metrics.json")
    assert {r.dataset for r in records} == {"kitti/01"}  # Table III's, as far as they are there
    measured = {r.estimator for r in select(records, metric="rpe_rot_median_deg")}
    ours = {"lcmsac-nominal", "lcmsac-self-calibrated", "lcmsac-boresight"}
    assert measured == ours | {"opencv-ransac", "opencv-magsac", "poselib", "poselib-cauchy"}
    (paper,) = select(records, estimator="lcmsac-paper")
    assert (paper.value, paper.metric) == (0.942, "t_err_percent")
    (short,) = select(records, estimator="lcmsac-nominal", metric="t_err_percent_low")
    assert short.value is None
    assert "holds no segment of 100 m" in short.protocol
    (turned,) = select(records, estimator="lcmsac-boresight", metric="rpe_trans_median_m")
    assert "boresight=causal" in turned.protocol
    assert "scale=truth-norm" in turned.protocol
    (calibrated,) = select(records, estimator="lcmsac-self-calibrated", metric="rpe_trans_median_m")
    assert "self_calibrate=true" in calibrated.protocol


def test_a_folder_without_them_says_so(root, model, tmp_path):
    with pytest.raises(DataError, match="none of the sequences 03"):
        kitti_table(root, model, tmp_path / "run", KittiOptions(sequences=("03",)))
    with pytest.raises(DataError, match="no KITTI odometry sequence"):
        find_sequences(tmp_path)
