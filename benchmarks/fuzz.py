"""Fuzz every reader and every file that flowlik loads, by damaging whole examples.

    python benchmarks/fuzz.py --seconds 600            # each target for ten minutes
    python benchmarks/fuzz.py --seconds 60 --only ros  # targets whose names begin with ros

Whatever is read must either be read or be refused by one of flowlik's own exceptions, in one line, within
ten seconds and two gigabytes. Each target runs in a process of its own, so that a crash of a decoder is a
finding and not the end. Findings leave the damaged files behind, and the exit code is 1.
"""

from __future__ import annotations

import argparse
import os
import random
import resource
import shutil
import subprocess
import sys
import tempfile
import time
import traceback
import warnings
from pathlib import Path

from flowlik.errors import FlowlikError
from fuzz_targets import Target, targets

MEMORY_BYTES = 2 << 30
SLOW_S = 10.0
WORDS = b'0123456789-.e, \n\t[]:#{}"naif'
NUMBERS = (b"\xff\xff\xff\x7f", b"\0\0\0\0", b"\xff\xff\xff\xff", b"\0\0\xff\xff", b"\x80\0\0\0", b"\1\0\0\0")


def damaged(data: bytes, rng: random.Random) -> bytes:
    """Cut, changed, lengthened, overwritten, replaced or repeated bytes."""
    found = bytearray(data)
    kind = rng.randrange(7)
    at = rng.randrange(len(found) + 1)
    if kind == 0:
        del found[at:]
    elif kind == 1 and found:
        for _ in range(rng.randint(1, 8)):
            found[rng.randrange(len(found))] = rng.randrange(256)
    elif kind == 2:
        found[at:at] = bytes(rng.choice(WORDS) for _ in range(rng.randint(1, 12)))
    elif kind == 3:
        found = bytearray(rng.randbytes(rng.randrange(100)))
    elif kind == 4:
        at = rng.randrange(min(64, len(found) + 1))
        found[at : at + 4] = rng.choice(NUMBERS)
    elif kind == 5:
        end = min(len(found), at + rng.randrange(64))
        found[at:at] = found[at:end] * rng.randint(1, 4)
    else:
        found[at : at + 4] = rng.choice(NUMBERS)
    return bytes(found)


def fuzz(
    target: Target, root: Path, seconds: float, rng: random.Random, most: int | None = None
) -> list[str]:
    """Damage and use one example until the time is up; what was found, each kind once."""
    path = target.make(root / "whole")
    target.use(path)
    files = [path] if path.is_file() else sorted(p for p in path.rglob("*") if p.is_file())
    files = files or sorted(p for p in root.rglob("*") if p.is_file())
    whole = {file: file.read_bytes() for file in files}
    found: dict[str, str] = {}
    runs = refused = 0
    slowest = 0.0
    end = time.monotonic() + seconds
    while time.monotonic() < end and (most is None or runs < most):
        chosen = {rng.choice(files) for _ in range(rng.randint(1, 3))}
        for file in chosen:
            file.write_bytes(damaged(whole[file], rng))
        start = time.monotonic()
        finding = ""
        try:
            target.use(path)
        except FlowlikError as error:
            refused += 1
            if "\n" in str(error):
                finding = f"message of several lines: {str(error)[:80]!r}"
        except Exception as error:
            where = traceback.extract_tb(error.__traceback__)[-1]
            finding = f"{type(error).__name__} in {Path(where.filename).name}:{where.lineno}: {error!s:.120}"
        took = time.monotonic() - start
        slowest = max(slowest, took)
        if took > SLOW_S:
            finding = finding or f"took {took:.0f} s"
        if finding and finding.split(": ")[0] not in found:
            found[finding.split(": ")[0]] = finding
            shutil.copytree(root / "whole", root / f"finding-{len(found)}")
        for file in chosen:
            file.write_bytes(whole[file])
        runs += 1
    used_mb = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024
    print(f"{runs} runs, {refused} refused, slowest {slowest:.2f} s, {used_mb:.0f} MB", flush=True)
    return list(found.values())


def in_this_process(name: str, seconds: float, seed: int, folder: Path) -> int:
    """Fuzz one target with bounded memory."""
    resource.setrlimit(resource.RLIMIT_AS, (3 * MEMORY_BYTES, 3 * MEMORY_BYTES))
    warnings.simplefilter("ignore")
    found = fuzz(targets()[name], folder, seconds, random.Random(seed))
    for finding in found:
        print(f"FOUND {finding}", flush=True)
    used = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss * 1024
    if used > MEMORY_BYTES:
        print(f"FOUND {used / 1e9:.1f} GB of memory", flush=True)
        return 1
    return 1 if found else 0


def main() -> int:
    """Fuzz all targets, one after another."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--seconds", type=float, default=5.0, help="for each target")
    parser.add_argument("--only", default="", help="targets whose names begin so")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--child", nargs=2, metavar=("TARGET", "FOLDER"), help=argparse.SUPPRESS)
    options = parser.parse_args()
    if options.child:
        name, folder = options.child
        return in_this_process(name, options.seconds, options.seed, Path(folder))
    base, failed = Path(tempfile.mkdtemp(prefix="fuzz-")), 0
    for name in targets():
        if not name.startswith(options.only):
            continue
        folder = base / name.replace(" ", "-")
        words = [sys.executable, __file__, "--seconds", str(options.seconds), "--seed", str(options.seed)]
        child = subprocess.run(
            [*words, "--child", name, str(folder)],
            stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True, errors="replace",
            env={**os.environ, "OPENCV_LOG_LEVEL": "SILENT"},
        )  # fmt: skip
        said = child.stdout.splitlines()
        lines = [line for line in said if line.startswith("FOUND") or " runs, " in line]
        print(f"{name:28} {lines[0] if lines else 'no runs'}", flush=True)
        print(*(f"    {line}" for line in lines[1:]), sep="\n", end="\n" if lines[1:] else "", flush=True)
        if child.returncode:
            failed += 1
            print(f"    exit {child.returncode}; files in {folder}")
            print("" if lines else child.stdout[-1500:])
        else:
            shutil.rmtree(folder, ignore_errors=True)
    if not failed:
        shutil.rmtree(base)
    return 1 if failed else 0


if __name__ == "__main__":
    sys.exit(main())
