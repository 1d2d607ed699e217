"""Put what the shipped models hold on images that they were not calibrated on beside them.

    python benchmarks/held_out.py

reads the tables of docs/calibration.md ("Real and other people's images", of `calibration.py`) and writes
`likelihood/held_out.json`, which `flowlik models` shows. Run it when that page has the figures of the models
that ship: they are noted as theirs. Frame rates are those of docs/egomotion.md and put in by hand; of a model
that has changed they are dropped.
"""

from __future__ import annotations

import json
import re
from pathlib import Path

from flowlik.commands._models import digest_of
from flowlik.likelihood.shipped import shipped

ROOT = Path(__file__).parents[1]
PAGE = ROOT / "docs/calibration.md"
FILE = ROOT / "src/flowlik/likelihood/held_out.json"
TABLES = {
    "Lucas-Kanade": "lucas-kanade",
    "Lucas-Kanade 11×11": "lucas-kanade-11",
    "Farnebäck": "farneback",
    "DIS": "dis",
}
COLUMNS = {"": 0, "-lcm": 1}  # index, GLC; texture, LCM


def held_out(page: str) -> dict[str, list[float]]:
    """Least and largest coverage of 90 % intervals of each model, over the pairs and clips that count."""
    _, _, rest = page.partition("## Real and other people's images")
    section = rest.partition("\n## ")[0]
    found = {}
    for head, name in TABLES.items():
        table = section.partition(f"\n**{head}**\n")[2].partition("\n\n**")[0]
        rows = re.findall(r"^\| (?!pair|---)(.+?) \|(.+)\|$", table, re.MULTILINE)
        cells = [row.split("|") for label, row in rows if not label.startswith("7-Scenes")]
        for suffix, column in COLUMNS.items():
            values = [float(row[column].split(",")[1]) for row in cells]
            found[name + suffix] = [min(values), max(values)]
    return found


def main() -> None:
    """Write the file anew."""
    kept = json.loads(FILE.read_text())
    for name, coverage in held_out(PAGE.read_text(encoding="utf-8")).items():
        model = kept["models"].setdefault(name, {"frames_per_second": None})
        digest = digest_of(shipped()[name])
        if model.get("digest") != digest:
            model["frames_per_second"] = None
        model |= {"coverage_90": coverage, "digest": digest}
    FILE.write_text(json.dumps(kept, indent=1) + "\n")


if __name__ == "__main__":
    main()
