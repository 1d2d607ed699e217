#!/usr/bin/env bash
# Tries flowlik with the oldest and the newest supported NumPy, SciPy and OpenCV: an install without extras runs
# every core command, and the whole test suite passes (tests of extras and of data that are not there skip themselves).
#
#     benchmarks/versions.sh [PYTHON [oldest|newest]]
set -euo pipefail
cd "$(dirname "${BASH_SOURCE[0]}")/.."
python=${1:-python3.11}
which=${2:-oldest newest}
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
    mkdir "$tmp/$name/checkout"
    cp -r tests docs benchmarks examples mkdocs.yml pyproject.toml README.md CHANGELOG.md CITATION.cff "$tmp/$name/checkout"
    local failed=0
    (cd "$tmp/$name/checkout" && NUMBA_CACHE_DIR=$tmp/$name/numba ../bin/python -m pytest -p no:cacheprovider) || failed=$?
    du -shc "$tmp/$name/lib" | tail -1
    return "$failed"
}

failed=0
for name in $which; do
    case $name in
        oldest) packages=('numpy==1.26.*' 'scipy==1.17.*' 'opencv-python-headless==4.10.*' 'numba==0.61.*') ;;
        newest) packages=('numpy>=2' 'scipy>=1.17' 'opencv-python-headless>=5,<6') ;;
        *) echo "versions.sh: oldest or newest, not $name" >&2; exit 2 ;;
    esac
    tried "$name" "${packages[@]}" || failed=1
done
exit "$failed"
