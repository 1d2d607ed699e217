#!/usr/bin/env bash
# Tries flowlik with the oldest and the newest supported NumPy, SciPy and OpenCV: an install without extras runs
# every core command, and the tests that depend on these packages pass.
#
#     benchmarks/versions.sh [PYTHON]
set -euo pipefail
cd "$(dirname "${BASH_SOURCE[0]}")/.."
python=${1:-python3.11}
tmp=$(mktemp -d)
trap 'rm -rf "$tmp"' EXIT

commands() {
    local flowlik=$1 out=$2
    "$flowlik" --version
    "$flowlik" doctor
    "$flowlik" models > /dev/null
    "$flowlik" simulate planes --frames 4 --width 128 --height 96 --out "$out/flight"
    local images=$out/flight/image_lcam_front
    "$flowlik" flow "$images/000000_lcam_front.png" "$images/000001_lcam_front.png" --model dis --out "$out/flow"
    "$flowlik" odometry "$out/flight" --model lucas-kanade --out "$out/walk"
    "$flowlik" calibrate "$out/flight" --method lucas-kanade --schedule texture --out "$out/calibration"
    "$flowlik" evaluate lucas-kanade "$out/flight" --out "$out/evaluation"
    "$flowlik" drift "$out/walk/trajectory_kitti.txt" "$out/walk/trajectory_kitti.txt" > /dev/null
    "$flowlik" report "$out/walk"
}

tried() {
    local name=$1
    shift
    echo "== $name: $*"
    "$python" -m venv "$tmp/$name"
    "$tmp/$name/bin/pip" install --quiet --disable-pip-version-check . "$@"
    NUMBA_CACHE_DIR=$tmp/$name/numba commands "$tmp/$name/bin/flowlik" "$tmp/$name/out"
    "$tmp/$name/bin/pip" install --quiet --disable-pip-version-check pytest hypothesis "$@"
    (cd "$tmp/$name" && cp -r "$OLDPWD/tests" "$OLDPWD/docs" "$OLDPWD/pyproject.toml" . &&
        NUMBA_CACHE_DIR=$tmp/$name/numba bin/python -m pytest -x tests/flow tests/datasets tests/test_motion.py \
            tests/test_texture.py tests/test_likelihood.py tests/test_trajectory.py tests/families)
    du -shc "$tmp/$name/lib" | tail -1
}

tried oldest 'numpy==1.26.*' 'scipy==1.16.*' 'opencv-python-headless==4.10.*' 'numba==0.61.*'
tried newest 'numpy>=2' 'scipy>=1.17' 'opencv-python-headless>=5,<6'
