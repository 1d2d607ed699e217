#!/usr/bin/env bash
# Tries flowlik with the oldest and the newest supported dependencies: an install without extras runs every core
# command, and the test suite passes (tests of extras and of data that are not there skip themselves). The oldest are
# the lower bounds of pyproject.toml. Arguments for pytest choose among the tests; all of them by default.
#
#     benchmarks/versions.sh [PYTHON [oldest|newest|both [PYTEST_ARGUMENT...]]]
set -euo pipefail
cd "$(dirname "${BASH_SOURCE[0]}")/.."
python=${1:-python3.11}
which=${2:-both}
tests=("${@:3}")

if [ "$which" = both ]; then  # in shells of their own: `set -e` does not hold inside of a condition
    failed=0
    for which in oldest newest; do
        bash benchmarks/versions.sh "$python" "$which" ${tests[@]+"${tests[@]}"} || failed=1
    done
    exit "$failed"
fi

lower_bounds() {
    "$python" - << 'PYTHON'
import re
import tomllib
from pathlib import Path

for needed in tomllib.loads(Path("pyproject.toml").read_text())["project"]["dependencies"]:
    name, version = re.match(r"([\w-]+)>=([\d.]+)", needed).groups()
    print(f"{name}=={version if '.' in version else version + '.0'}.*")
PYTHON
}

case $which in
    oldest) packages=$(lower_bounds) ;;
    newest) packages="numpy>=2 scipy>=1.17 opencv-python-headless>=5,<6" ;;
    *) echo "versions.sh: oldest, newest or both, not $which" >&2; exit 2 ;;
esac
read -r -d '' -a packages <<< "$packages" || true

tmp=$(mktemp -d)
trap 'rm -rf "$tmp"' EXIT
bin=$tmp/venv/bin
export NUMBA_CACHE_DIR=$tmp/numba PIP_DISABLE_PIP_VERSION_CHECK=1

echo "== $which: ${packages[*]}"
"$python" -m venv "$tmp/venv"
"$bin/pip" install --quiet . "${packages[@]}"
"$bin/pip" list

"$bin/flowlik" --version
"$bin/flowlik" doctor
"$bin/flowlik" models > /dev/null
"$bin/flowlik" simulate planes --frames 4 --width 128 --height 96 --out "$tmp/flight"
images=$tmp/flight/image_lcam_front
"$bin/flowlik" flow "$images/000000_lcam_front.png" "$images/000001_lcam_front.png" --model dis --out "$tmp/flow"
"$bin/flowlik" odometry "$tmp/flight" --model lucas-kanade --out "$tmp/walk"
"$bin/flowlik" calibrate "$tmp/flight" --method lucas-kanade --schedule texture --out "$tmp/calibration"
"$bin/flowlik" evaluate lucas-kanade "$tmp/flight" --out "$tmp/evaluation"
"$bin/flowlik" drift "$tmp/walk/trajectory_kitti.txt" "$tmp/walk/trajectory_kitti.txt" > /dev/null
"$bin/flowlik" report "$tmp/walk"

"$bin/pip" install --quiet pytest hypothesis "${packages[@]}"
mkdir "$tmp/checkout"
cp -r src tests docs benchmarks examples mkdocs.yml pyproject.toml README.md CHANGELOG.md CITATION.cff CONTRIBUTING.md "$tmp/checkout"
cd "$tmp/checkout"
"$bin/python" -m pytest -p no:cacheprovider ${tests[@]+"${tests[@]}"}
