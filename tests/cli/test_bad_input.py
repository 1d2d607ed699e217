"""Bad input: exit code 2, one line that says what is wrong, and nothing half-written."""

import csv
import shutil

import cv2
import numpy as np
import pytest

from flowlik.datasets.tartanair import encode_depth
from tests.cli.call import call, refuse, succeed
from tests.cli.conftest import blank_images, image_of
from tests.datasets.test_kitti import write_poses


def truncate(path, by=300):
    path.write_bytes(path.read_bytes()[:-by])


def test_images_missing_truncated_or_of_other_sizes(flight, models, tmp_path, out):
    good, model = image_of(flight, 0), models["farneback"]
    short, small = tmp_path / "short.png", tmp_path / "small.png"
    shutil.copy(good, short)
    truncate(short)
    cv2.imwrite(str(small), np.zeros((50, 96), np.uint8))
    cases = {
        tmp_path / "none.png": "none.png: no such image file",
        short: "short.png: not a readable image",
        small: "the two images differ in size: 96x64 and 96x50",
        flight: "cannot be read",
    }
    for second, message in cases.items():
        refuse("flow", good, second, "--model", model, out=out, message=message)


def truncated_image(folder):
    truncate(image_of(folder, 3))
    return "000003_lcam_front.png: not a readable image"


def image_of_another_size(folder):
    cv2.imwrite(str(image_of(folder, 3)), np.zeros((50, 96, 3), np.uint8))
    return "image is 96x50, the camera is 96x64"


def truncated_depth(folder):
    truncate(folder / "depth_lcam_front" / "000003_lcam_front_depth.png")
    return "000003_lcam_front_depth.png: not a readable image"


def wrong_columns(folder):
    (folder / "pose_lcam_front.txt").write_text("1 2 3 4 5 6\n" * 9)
    return "line 1: 6 columns, but expected 7 numbers (a TartanAir pose: x y z qx qy qz qw, axes NED)"


def too_few_poses(folder):
    path = folder / "pose_lcam_front.txt"
    path.write_text("".join(path.read_text().splitlines(keepends=True)[:5]))
    return "5 poses for the 9 images"


def no_texture(folder):
    blank_images(folder)
    return "flow vectors, 3 needed"


def no_depth(folder):
    for path in (folder / "depth_lcam_front").iterdir():
        cv2.imwrite(str(path), encode_depth(np.full((64, 96), np.nan)))
    return "0 flow vectors, 3 needed"


@pytest.mark.parametrize(
    "damage",
    [truncated_image, image_of_another_size, truncated_depth, wrong_columns, too_few_poses, no_texture,
     no_depth],
)  # fmt: skip
def test_a_damaged_sequence_is_not_flown(copy, models, out, damage):
    message = damage(copy)
    refuse("odometry", copy, "--model", models["lucas-kanade"], out=out, message=message)
    assert not out.exists()


@pytest.mark.parametrize("damage", [truncated_image, truncated_depth, wrong_columns, no_texture, no_depth])
@pytest.mark.parametrize("command", ["calibrate", "evaluate"])
def test_a_damaged_sequence_neither_calibrates_nor_judges(copy, models, out, damage, command):
    message = damage(copy)
    if damage in (no_texture, no_depth):
        message = {"calibrate": "0 error components are too few", "evaluate": "no errors to evaluate"}[
            command
        ]
    words = {
        "calibrate": (copy, "--method", "lucas-kanade"),
        "evaluate": (models["lucas-kanade"], copy),
    }
    refuse(command, *words[command], out=out, message=message)


@pytest.mark.usefixtures("undrawn")
def test_depth_of_nan_and_zeros_is_left_out_and_counted(copy, models, out):
    depth = np.full((64, 96), 5.0)
    depth[:, ::2], depth[::2] = 0, np.nan
    for k, values in {2: depth, 4: np.zeros((64, 96))}.items():
        cv2.imwrite(str(copy / f"depth_lcam_front/{k:06d}_lcam_front_depth.png"), encode_depth(values))
    succeed("odometry", copy, "--model", models["lucas-kanade"], "--out", out)
    rows = {int(row["frame"]): row for row in csv.DictReader((out / "frames.csv").open())}
    counts = {
        k: dict(pair.split(":") for pair in row["excluded"].split() if "depth" in pair)
        for k, row in rows.items()
    }
    assert {k for k in counts if counts[k]} == {3, 5}
    assert rows[1]["status"] == "solved"
    assert (rows[5]["status"], rows[5]["reason"]) == ("too few", "0 flow vectors, 3 needed")
    n3, n5 = (int(counts[k]["depth"]) for k in (3, 5))
    assert 0 < n3 < n5


def test_one_image_is_no_sequence(copy, models, out):
    for k in range(1, 9):
        image_of(copy, k).unlink()
    model = models["lucas-kanade"]
    refuse("odometry", copy, "--model", model, out=out, message="only one image")
    refuse("calibrate", copy, "--method", "farneback", out=out, message="no image pairs")
    refuse("evaluate", model, copy, out=out, message="no errors to evaluate (one image")


MODEL_CHANGES = {
    "unknown image derivative 'sobel'": lambda c: c["texture"].update(derivative="sobel"),
    "window must be odd": lambda c: c["texture"].update(window=4),
    "not a flowlik model file (texture": lambda c: c.pop("texture"),
    "unknown flow method": lambda c: c["flow"].update(name="dis"),
    "unknown flow method {": lambda c: c["flow"].update(radius=3),
    "unknown error family 'cauchy'": lambda c: c.update(family="cauchy"),
    "knots and parameters differ in number": lambda c: c["knots"].pop(),
    "schema_version": lambda c: c.update(schema_version=1),
}


@pytest.mark.parametrize("message", MODEL_CHANGES)
def test_models_that_contradict_themselves(flight, edited, out, message):
    model = edited(MODEL_CHANGES[message])
    refuse("odometry", flight, "--model", model, out=out, message=message)


@pytest.mark.parametrize("content", [b"", b"{}", b"[1]", b"not json", b"\x89PNG\xff"])
@pytest.mark.parametrize("command", ["odometry", "flow", "evaluate"])
def test_a_file_that_is_no_model(flight, tmp_path, out, content, command):
    path = tmp_path / "model.json"
    path.write_bytes(content)
    words = {
        "odometry": (flight, "--model", path),
        "flow": (image_of(flight, 0), image_of(flight, 1), "--model", path),
        "evaluate": (path, flight),
    }
    refuse(command, *words[command], out=out, message="model.json: not a flowlik model file")


def test_a_model_of_another_flow_method(flight, models, tmp_path, out):
    message = "the model is for the flow lucas-kanade, not for 'farneback'"
    options = ("--model", models["lucas-kanade"], "--method", "farneback")
    refuse("odometry", flight, *options, out=out, message=message)
    refuse("flow", image_of(flight, 0), image_of(flight, 1), *options, out=out, message=message)
    missing = ("--model", tmp_path / "none.json")
    refuse("odometry", flight, *missing, out=out, message="none.json: cannot read the model file")


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (("calibrate", "FLIGHT", "--method", "raft"), "unknown flow method 'raft': known are farneback"),
        (("calibrate", "FLIGHT", "--method", "farneback", "--family", "x"), "unknown error family 'x'"),
        (
            ("calibrate", "FLIGHT", "--method", "farneback", "--format", "scannet"),
            "format 'scannet', known are",
        ),
        (("calibrate", "nowhere", "--method", "farneback"), "nowhere: no such file or folder"),
        (("odometry", "FLIGHT"), "--estimator lcmsac needs --model"),
        (("odometry", "FLIGHT", "--estimator", "mle"), "--estimator mle needs --model"),
        (("odometry", "FLIGHT", "--estimator", "ransac", "--adapt"), "--adapt follows a model's errors"),
        (("odometry", "FLIGHT", "--estimator", "best"), "unknown estimator 'best': known are ransac"),
        (("odometry", "FLIGHT", "--model", "MODEL", "--scale", "gps"), "unknown scale source 'gps': known"),
        (
            ("odometry", "FLIGHT", "--model", "MODEL", "--scale", "camera-height"),
            "needs --camera-height, the",
        ),
        (
            ("odometry", "FLIGHT", "--model", "MODEL", "--scale", "camera-height", "--camera-height", "0"),
            "must be positive",
        ),
        (("odometry", "FLIGHT", "--model", "MODEL", "--camera-height", "1.65"), "no use with --scale none"),
        (("odometry", "FLIGHT", "--model", "MODEL", "--residual", "x"), "unknown residual 'x': known are"),
        (("odometry", "FLIGHT", "--model", "MODEL", "--format", "tum"), "format 'tum', known are kitti"),
        (("odometry", "FLIGHT", "--model", "MODEL", "--camera", "1,2,3"), "tartanair has its own camera"),
        (("odometry", "FLIGHT", "--model", "MODEL", "--min-texture", "nan"), "--min-texture must be"),
        (("odometry", "FLIGHT", "--model", "MODEL", "--min-texture", "-1"), "--min-texture must be"),
        (("odometry", "FLIGHT", "--model", "MODEL", "--min-texture", "1e9"), "0 flow vectors, 3 needed"),
        (("flow", "FIRST", "SECOND", "--model", "MODEL", "--confidence", "1"), "confidence"),
        (("flow", "FIRST", "SECOND", "--model", "MODEL", "--confidence", "nan"), "confidence"),
        (("flow", "FIRST", "SECOND", "--model", "MODEL", "--truth", "x.txt"), "unknown flow format"),
        (("reproduce",), "flowlik reproduce --quick"),
    ],
    ids=lambda value: "-".join(value[:2] + value[-2:]) if isinstance(value, tuple) else "",
)
def test_options_that_cannot_be(flight, models, out, words, message):
    places = {
        "FLIGHT": flight,
        "MODEL": models["lucas-kanade"],
        "FIRST": image_of(flight, 0),
        "SECOND": image_of(flight, 1),
    }
    refuse(*(places.get(word, word) for word in words), out=out, message=message)
    assert not out.exists()


def test_blank_images_have_no_corners_to_measure(copy, models, out):
    blank_images(copy)
    words = ("flow", image_of(copy, 0), image_of(copy, 1), "--model", models["lucas-kanade"])
    refuse(*words, out=out, message="no flow vector could be measured")


def test_true_flow_of_another_size_or_none(flight, models, tmp_path, out):
    words = ("flow", image_of(flight, 0), image_of(flight, 1), "--model", models["farneback"], "--truth")
    np.save(tmp_path / "small.npy", np.zeros((64, 95, 2)))
    np.save(tmp_path / "unknown.npy", np.full((64, 96, 2), np.nan))
    small = "small.npy: true flow of 95x64, the images 96x64"
    refuse(*words, tmp_path / "small.npy", out=out, message=small)
    refuse(*words, tmp_path / "unknown.npy", out=out, message="unknown.npy: no true flow is known")
    refuse(*words, tmp_path / "none.npy", out=out, message="no such flow file")


@pytest.mark.parametrize("command", ["odometry", "calibrate", "evaluate", "flow", "simulate"])
def test_a_folder_that_holds_something_else_is_left_alone(flight, models, tmp_path, command):
    model = models["lucas-kanade"]
    words = {
        "odometry": (flight, "--model", model),
        "calibrate": (flight, "--method", "lucas-kanade"),
        "evaluate": (model, flight),
        "flow": (image_of(flight, 0), image_of(flight, 1), "--model", model),
        "simulate": ("planes", "--frames", 2),
    }
    folder, file = tmp_path / "thesis", tmp_path / "file"
    folder.mkdir()
    (folder / "chapter.txt").write_text("precious")
    file.write_text("precious")
    refuse(command, *words[command], out=folder, message="something else")
    refuse(command, *words[command], out=file, message="is a file")
    assert [p.name for p in folder.iterdir()] == ["chapter.txt"]
    assert file.read_text() == "precious"


@pytest.mark.usefixtures("undrawn")
def test_a_run_of_another_command_is_left_alone(flight, models, tmp_path, out):
    succeed("odometry", flight, "--model", models["lucas-kanade"], "--frames", 3, "--out", out)
    before = {path: path.read_bytes() for path in out.rglob("*") if path.is_file()}
    outcome = call("evaluate", models["lucas-kanade"], flight, "--out", out)
    assert outcome.code == 2 and "something else" in outcome.err[0]
    assert {path: path.read_bytes() for path in out.rglob("*") if path.is_file()} == before


@pytest.mark.parametrize(
    ("content", "message"),
    [("", "empty"), ("1 2 3\n", "3 columns"), ("nan " * 12, "not a finite number"), ("2 " * 12, "rotation")],
)
def test_trajectories_that_are_none(tmp_path, content, message):
    good, bad = tmp_path / "good.txt", tmp_path / "bad.txt"
    write_poses(good, 3)
    bad.write_text(content)
    for pair in ((bad, good), (good, bad)):
        outcome = call("drift", *pair)
        assert (outcome.code, len(outcome.err)) == (2, 1)
        assert "bad.txt" in outcome.err[0] and message in outcome.err[0]


def test_trajectories_of_different_length(tmp_path):
    for count in (1, 3, 4):
        write_poses(tmp_path / f"{count}.txt", count)
    for first, second, message in [(3, 4, "3"), (1, 1, "one pose is no trajectory")]:
        outcome = call("drift", tmp_path / f"{first}.txt", tmp_path / f"{second}.txt")
        assert (outcome.code, len(outcome.err)) == (2, 1)
        assert message in outcome.err[0]


def test_a_folder_without_a_run_has_no_report(tmp_path):
    outcome = call("report", tmp_path)
    assert (outcome.code, len(outcome.err)) == (2, 1)
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize(
    ("option", "package", "extra"), [("--save-rerun", "rerun", "viz"), ("--save-bag", "rosbags", "ros")]
)
def test_a_missing_extra_is_one_line_that_names_it(flight, out, monkeypatch, option, package, extra):
    def lacking(name):
        raise ModuleNotFoundError(name)

    monkeypatch.setattr("flowlik.support.extras.import_module", lacking)
    outcome = call("odometry", flight, "--estimator", "ransac", option, "--out", out)
    assert outcome.code == 2
    assert len(outcome.err) == 1
    assert outcome.err[0].endswith(f"needs {package}: pip install 'flowlik[{extra}]'")


@pytest.mark.parametrize("command", ["calibrate", "evaluate", "odometry"])
def test_a_camera_for_data_that_has_its_own(flight, models, out, command):
    words = {
        "calibrate": (flight, "--method", "dis"),
        "evaluate": (models["lucas-kanade"], flight),
        "odometry": (flight, "--estimator", "ransac"),
    }[command]
    refuse(command, *words, "--camera", "50,48,32", out=out, message="has its own camera")


def test_a_camera_file_that_is_none(flight, out, tmp_path):
    (tmp_path / "camera.yaml").write_text("a: 1")
    images = flight / "image_lcam_front"
    words = ("odometry", images, "--estimator", "ransac", "--camera", tmp_path / "camera.yaml")
    refuse(*words, out=out, message="neither camera_matrix nor intrinsics")
