"""The same numbers at two heads: keep what the installed commands compute, and compare two such folders.

    python benchmarks/same_numbers.py --make OLD --data DATA    # the Python that has the old head installed
    python benchmarks/same_numbers.py --make NEW --data DATA    # and the one with the new head
    python benchmarks/same_numbers.py OLD NEW

Numbers agree to 1e-9 of the largest entry of their column, list or record, or to the last digit of files
that hold fewer; counts and words agree exactly, and frames where they do not are listed. A line is printed
for every file; the exit code is 1 if any differs. Rates, times, memory, versions and commands are left out.
"""

from __future__ import annotations

import argparse
import csv
import hashlib
import json
import re
import shutil
import subprocess
import sys
import tempfile
import time
from contextlib import suppress
from pathlib import Path
from typing import Any

import numpy as np

KITTI = "odometry KITTI --frames 60 --model lucas-kanade-11 --scale truth-norm"
RUNS = {
    "flight": "simulate forest-small --trajectory curve --frames 32 --width 320 --height 180 --seed 7",
    "kitti-lcmsac": KITTI,
    "kitti-ransac": f"{KITTI} --estimator ransac",
    "kitti-self-calibrated": f"{KITTI} --self-calibrate",
    **{f"odometry-{m}": f"odometry FLIGHT --model {m}" for m in ("lucas-kanade", "dis", "farneback")},
    **{f"calibrate-{m}": f"calibrate FLIGHT --method {m}" for m in ("lucas-kanade-11", "dis")},
    "reproduce": "reproduce --quick",
}
KEPT = ("*.txt", "*.csv", "metrics.json", "models/*.json")
RENAMED = {"emphasis": "shared_errors.composite_power", "score_correlation": "shared_errors.correlation"}
"""Keys of a model file: the old name, and the new one that its numbers are compared under."""
LEFT_OUT = re.compile(r"schema_version|provenance\.(versions|command|date)(\..*)?")
UNITS_LEFT_OUT = ("1/s", "s", "ms", "us", "MB", "GB")
TOLERANCE = 1e-9
LAST_DIGIT = {
    "outside_fraction": 1e-4,
    "log_prob_nat": 1e-3,
    **{f"shared_errors.correlation.{kind}": 1e-9 for kind in ("isotropic", "along", "vertical")},
}
SIX_DIGITS = re.compile(r"sigma_\w+|f|cx|cy|k1|k2")
"""Columns and lists that the commands round before they write them."""


def make(folder: Path, data: Path | None, names: list[str]) -> None:
    """Run the commands of the flowlik beside this Python, and keep their numbers, a folder a run."""
    program = shutil.which("flowlik", path=str(Path(sys.executable).parent))
    if program is None:
        sys.exit("same_numbers.py: flowlik is not installed for this Python")
    with tempfile.TemporaryDirectory() as made:
        flight = Path(made) / "flight"
        places = {"FLIGHT": flight, "KITTI": data and data / "kitti_odometry" / "03"}
        for name in [name for name in RUNS if name in names]:
            begun, out, words = time.monotonic(), Path(made) / name, RUNS[name].split()
            if "KITTI" in words and data is None:
                print(f"{name}: left out, no --data")
                continue
            arguments = [str(places.get(word, word)) for word in words]
            subprocess.run([program, *arguments, "--out", str(out)], check=True, stdout=subprocess.DEVNULL)
            if out == flight:
                images = [(p.name, hashlib.sha256(p.read_bytes())) for p in sorted(flight.glob("*/*.png"))]
                rows = ["frame,sha256", *(f"{image},{found.hexdigest()}" for image, found in images)]
                (flight / "images.csv").write_text("\n".join(rows))
            for path in [path for pattern in KEPT for path in out.glob(pattern)]:
                target = folder / path.relative_to(made)
                target.parent.mkdir(parents=True, exist_ok=True)
                shutil.copyfile(path, target)
            print(f"{name}: {time.monotonic() - begun:.0f} s", flush=True)


def columns(path: Path) -> dict[str, list[Any]]:
    """Lists of numbers or words of a file, by name."""
    if path.suffix == ".json":
        content = json.loads(path.read_text())
        return records(content) if path.name == "metrics.json" else leaves(content)
    if path.suffix == ".csv":
        header, *rows = csv.reader(path.read_text().splitlines())
    else:
        rows = [line.split() for line in path.read_text().splitlines()]
        header = [f"column {number}" for number in range(1, len(rows[0]) + 1)]
    return {name: parsed([row[k] for row in rows]) for k, name in enumerate(header)}


def parsed(column: list[str]) -> list[Any]:
    """What a column of a table says: counts, numbers, or words."""
    for kind in (int, float):
        with suppress(ValueError):
            return [kind(word) for word in column]
    return column


def records(rows: list[dict[str, Any]]) -> dict[str, list[Any]]:
    """Values, counts and protocols of records, by what they are of; equal names stay in order."""
    found: dict[str, list[Any]] = {}
    for row in rows:
        if row["unit"] not in UNITS_LEFT_OUT:
            notes = dict(item.partition("=")[::2] for item in row.pop("protocol").split("; "))
            numbers = {key: row.pop(key) for key in ("value", "unit", "count")}
            name = " ".join(str(word) for word in row.values() if word is not None)
            for key, value in {**notes, **numbers}.items():
                found.setdefault(f"{name}: {key}", []).append(value)
    return found


def leaves(content: Any, name: str = "") -> dict[str, list[Any]]:
    """Lists and single values of a model file, by the keys that lead to them, under their new names."""
    name = RENAMED.get(name, name)
    if LEFT_OUT.fullmatch(name):
        return {}
    if isinstance(content, list) and any(isinstance(item, dict) for item in content):
        content = dict(enumerate(content))
    if not isinstance(content, dict):
        return {name: content if isinstance(content, list) else [content]}
    inner = [leaves(value, f"{name}.{key}" if name else key) for key, value in content.items()]
    return {key: values for found in inner for key, values in found.items()}


def differences(old: dict[str, list[Any]], new: dict[str, list[Any]]) -> tuple[list[str], float]:
    """A line for whatever differs, and the largest difference of numbers over the largest of them."""
    lines = [f"{name}: only in {'old' if name in old else 'new'}" for name in sorted(old.keys() ^ new.keys())]
    worst, frames = 0.0, old.get("frame", [])
    for name in [name for name in old if name in new]:
        a, b = old[name], new[name]
        kinds = {type(value) for value in (*a, *b)}
        if len(a) != len(b):
            lines.append(f"{name}: {len(a)} entries -> {len(b)}")
        elif float not in kinds or not kinds <= {int, float}:
            for k in [k for k in range(len(a)) if a[k] != b[k]]:
                lines.append((f"frame {frames[k]}, " if frames else "") + f"{name}: {a[k]} -> {b[k]}")
        else:
            off, share = apart(name, np.array(a, float), np.array(b, float))
            worst = max(worst, share)
            if off:
                lines.append(f"{name}: {off} of {len(a)} numbers, by up to {share:.1e} of the largest")
    return lines, worst


def apart(name: str, a: np.ndarray, b: np.ndarray) -> tuple[int, float]:
    """How many numbers differ, and the largest difference over the largest of them."""
    known = np.isfinite(a) & np.isfinite(b)
    sizes = np.where(known, np.maximum(np.abs(a), np.abs(b)), 0.0)
    digit = np.full(len(a), LAST_DIGIT.get(name, 0.0))
    if SIX_DIGITS.fullmatch(name):
        digit = 10 ** (np.floor(np.log10(np.maximum(sizes, 1e-99))) - 5)
    same = np.isclose(a, b, rtol=0, atol=TOLERANCE * sizes.max() + 1.001 * digit, equal_nan=True)
    gap = np.abs(a[known] - b[known]).max(initial=0.0) if (same | known).all() else np.inf
    return int((~same).sum()), float(gap / sizes.max()) if gap else 0.0


def compare(old: Path, new: Path) -> bool:
    """Print a line a file, and below it what differs; whether none does."""
    equal = True
    files = {p.relative_to(folder) for folder in (old, new) for p in folder.rglob("*") if p.is_file()}
    for path in sorted(files):
        lacking = [str(folder) for folder in (old, new) if not (folder / path).is_file()]
        if lacking:
            lines, worst = [f"not in {lacking[0]}"], 0.0
        else:
            lines, worst = differences(columns(old / path), columns(new / path))
        outcome = "DIFFERS" if lines else f"same to {worst:.0e}" if worst else "same"
        print("\n    ".join([f"{path.as_posix()}: {outcome}", *lines]))
        equal = equal and not lines
    return equal and bool(files)


def main() -> int:
    """Make or compare, as the options say."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("folders", nargs="*", type=Path, metavar="OLD NEW", help="folders to compare")
    parser.add_argument("--make", type=Path, metavar="DIR", help="run the commands and keep their numbers")
    parser.add_argument("--data", type=Path, help="with kitti_odometry/03; without it, KITTI is left out")
    parser.add_argument(
        "--only", nargs="+", metavar="NAME", choices=RUNS, default=list(RUNS), help=f"of {', '.join(RUNS)}"
    )
    options = parser.parse_args()
    if options.make is not None:
        flight = ["flight"] if any("FLIGHT" in RUNS[name] for name in options.only) else []
        make(options.make, options.data, [*flight, *options.only])
    elif len(options.folders) == 2:
        return 0 if compare(*options.folders) else 1
    else:
        parser.error("give two folders, or --make DIR")
    return 0


if __name__ == "__main__":
    sys.exit(main())
