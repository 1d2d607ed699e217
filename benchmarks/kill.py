"""Kill simulate and calibrate at random moments: each resumes or starts over, and never ends wrong.

    python benchmarks/kill.py --runs 50

Every run is started in a process of its own, killed by SIGKILL after a random time, and repeated until it
ends; half of the repetitions are killed again. What it leaves must then equal what an undisturbed run
leaves: every byte of a simulated data set, and the model of a calibration but for its records of time. The
exit code is 1 if one did not.
"""

from __future__ import annotations

import argparse
import contextlib
import json
import os
import random
import shutil
import signal
import sys
import tempfile
import time
from functools import partial
from pathlib import Path

from flowlik.cli import main as flowlik
from flowlik.commands import _calibrate as calibration
from flowlik.report import build  # noqa: F401  loaded once, before the processes part

SIMULATE = [
    "simulate",
    "planes",
    "--trajectory",
    "training",
    "--frames",
    "12",
    "--width",
    "64",
    "--height",
    "48",
]
CALIBRATE = ["calibrate", "DATA", "--method", "lucas-kanade", "--schedule", "texture", "--family", "lcm"]

# files are tried here, not fits: one family with one prior, and no bands, so that a run takes a second
calibration.fit_families = partial(calibration.fit_families, names=("lcm",), smoothing=1e-5)
calibration.BAND_REPLICATES = 1


def start(words: list[str]) -> int:
    """Run a command in a child; its process id."""
    child = os.fork()
    if child:
        return child
    with (
        Path(os.devnull).open("w") as sink,
        contextlib.redirect_stdout(sink),
        contextlib.redirect_stderr(sink),
    ):
        sys.argv = ["flowlik", *words]
        code = 0
        try:
            flowlik()
        except SystemExit as end:
            code = int(end.code or 0)
        except BaseException:
            code = 99
    os._exit(code)


def run(words: list[str], kill_after_s: float | None = None) -> tuple[int, float]:
    """Exit code, negative if it was killed, and how long it took."""
    begun = time.monotonic()
    child = start(words)
    if kill_after_s is not None:
        time.sleep(kill_after_s)
        with contextlib.suppress(ProcessLookupError):
            os.kill(child, signal.SIGKILL)
    _, status = os.waitpid(child, 0)
    return os.waitstatus_to_exitcode(status), time.monotonic() - begun


def left(folder: Path, command: str) -> object:
    """What must be equal: the bytes of a data set, or a model without what tells of time."""
    if command == "simulate":
        files = sorted(p for p in folder.rglob("*") if p.is_file())
        return {str(p.relative_to(folder)): p.read_bytes() for p in files}
    (path,) = (folder / "models").glob("*.json")
    model = json.loads(path.read_text())
    return {key: model[key] for key in ("family", "index", "knots", "table", "shared_errors")}


def main() -> int:
    """Kill and repeat; print what came of it."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--runs", type=int, default=50)
    parser.add_argument("--seed", type=int, default=0)
    options = parser.parse_args()
    rng = random.Random(options.seed)
    base, wrong = Path(tempfile.mkdtemp(prefix="kill-")), 0
    words = {
        "simulate": SIMULATE,
        "calibrate": [w.replace("DATA", str(base / "simulate")) for w in CALIBRATE],
    }
    whole, usual_s = {}, {}
    for command in words:
        for _ in range(2):  # the first time kernels are compiled
            shutil.rmtree(base / command, ignore_errors=True)
            code, usual_s[command] = run([*words[command], "--out", str(base / command)])
            assert code == 0, (command, code)
        whole[command] = left(base / command, command)
    for number in range(options.runs):
        command = ("simulate", "calibrate")[number % 2]
        out = base / f"{command}-{number}"
        kills = attempts = 0
        code = -1
        while code < 0 and attempts < 20:
            again = kills == 0 or (kills < 3 and rng.random() < 0.5)
            code, _ = run(
                [*words[command], "--out", str(out)], rng.uniform(0, usual_s[command]) if again else None
            )
            kills += code < 0
            attempts += 1
        good = code == 0 and left(out, command) == whole[command]
        stray = [p.name for p in out.rglob("*") if p.name.endswith(".part") or p.name == "unfinished.json"]
        wrong += not good
        outcome = "equal" if good else "WRONG"
        print(f"{number:3} {command:9} killed {kills}, exit {code}, {outcome}", stray or "", flush=True)
        if good:
            shutil.rmtree(out)
    print(f"{options.runs} runs, {wrong} wrong")
    if not wrong:
        shutil.rmtree(base)
    return 1 if wrong else 0


if __name__ == "__main__":
    sys.exit(main())
