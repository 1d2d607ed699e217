"""Look at a report as a browser shows it: no console errors, no overflow, light and dark, wide and narrow.

What it answers must stand on the first screen of a desktop, and all else be folded.

    python benchmarks/page.py RUN [--out FOLDER]

Needs Chromium. With --out, screenshots are left to look at. The exit code is 1 if something is wrong.
"""

from __future__ import annotations

import argparse
import json
import os
import re
import shutil
import subprocess
import sys
import tempfile
from pathlib import Path

BROWSERS = ("chromium", "chromium-browser", "google-chrome")
WIDTHS = {"phone": 390, "desktop": 1280}
FIRST_SCREEN = 800  # px: what a desktop shows without scrolling
PROBE = """<script>
addEventListener("load", () => {
  const images = [...document.images];
  const found = {
    overflow: document.documentElement.scrollWidth - innerWidth,
    images: images.length,
    broken: images.filter(i => i.loading != "lazy" && (!i.complete || !i.naturalWidth)).length,
    uncaptioned: [...document.querySelectorAll(".grid figure")].filter(
      f => !f.querySelector("figcaption").textContent.trim() || !f.querySelector(".made code")).length,
    first: Math.ceil(document.querySelector("#first").getBoundingClientRect().bottom),
    unfolded: document.querySelectorAll("details[open]").length,
    cut: [...document.querySelectorAll("#first table, #first img, #first dl")].filter(
      e => e.getBoundingClientRect().right > innerWidth || e.scrollWidth > e.clientWidth + 1).length,
    remote: performance.getEntriesByType("resource").filter(r => /^https?:/.test(r.name)).length,
    page: getComputedStyle(document.body).backgroundColor,
  };
  const said = document.createElement("pre");
  said.id = "probe";
  said.textContent = JSON.stringify(found);
  document.body.append(said);
});
</script></body>"""

FRAME = """<body style="margin:0">
<iframe src="alone.html" style="border:0" width="WIDTH" height="1400"></iframe>
<script>
onload = () => setTimeout(() => {
  const inside = document.querySelector("iframe").contentDocument;
  document.body.append(inside.querySelector("#probe").cloneNode(true));
}, 500);
</script></body>"""


def browser() -> str | None:
    """Path of a Chromium: installed, or in Playwright's cache."""
    cache = Path(os.environ.get("PLAYWRIGHT_BROWSERS_PATH", Path.home() / ".cache" / "ms-playwright"))
    cached = sorted(cache.glob("chromium-*/chrome-linux*/chrome"), reverse=True)
    return next(filter(None, [*map(shutil.which, BROWSERS), *map(str, cached)]), None)


def shown(program: str, page: Path, width: int, dark: bool, *more: str) -> subprocess.CompletedProcess[str]:
    """Run the browser without a window."""
    words = [
        program, "--headless=new", "--no-sandbox", "--disable-gpu", "--hide-scrollbars",
        "--disable-extensions", "--enable-logging=stderr", "--allow-file-access-from-files",
        "--virtual-time-budget=5000", f"--window-size={width},1400",
        f"--blink-settings=preferredColorScheme={0 if dark else 1}",
    ]  # fmt: skip
    return subprocess.run([*words, *more, page.as_uri()], capture_output=True, text=True, timeout=300)


def check(program: str, page: Path, out: Path | None = None) -> list[str]:
    """What is wrong with a page in a browser, one line each."""
    wrong = []
    with tempfile.TemporaryDirectory() as folder:
        # a page with its figures, and nothing else of the run, must show the same
        alone = Path(folder) / "alone.html"
        alone.write_text(page.read_text().replace("</body>", PROBE))
        shutil.copytree(page.parent / "figures", Path(folder) / "figures")
        # headless Chromium has no window narrower than 500 px, a frame has
        for name, width in WIDTHS.items():
            for dark in (False, True):
                scheme = "dark" if dark else "light"
                frame = Path(folder) / "frame.html"
                frame.write_text(FRAME.replace("WIDTH", str(width)))
                ended = shown(program, frame, max(width, 500), dark, "--dump-dom")
                found = re.search(r'<pre id="probe">(.*?)</pre>', ended.stdout)
                errors = [line for line in ended.stderr.splitlines() if "CONSOLE" in line]
                wrong += [f"{name}, {scheme}: {line}" for line in errors]
                if found is None:
                    wrong.append(f"{name}, {scheme}: the page did not load ({ended.stderr[-200:]})")
                    continue
                facts = json.loads(found[1])
                print(f"{name:8} {scheme:6}", facts)
                for key in ("overflow", "broken", "uncaptioned", "unfolded", "cut", "remote"):
                    if facts[key] > 0:
                        wrong.append(f"{name}, {scheme}: {key} {facts[key]}")
                if name == "desktop" and facts["first"] > FIRST_SCREEN:
                    wrong.append(f"{name}, {scheme}: the first screen ends at {facts['first']} px")
                if out is not None:
                    out.mkdir(parents=True, exist_ok=True)
                    shot = (out / f"{name}-{scheme}.png").resolve()
                    shown(program, frame, max(width, 500), dark, f"--screenshot={shot}")
    return wrong


def main() -> int:
    """Check one report."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("run", type=Path)
    parser.add_argument("--out", type=Path)
    options = parser.parse_args()
    if (program := browser()) is None:
        sys.exit("no Chromium found; install one, such as the package chromium")
    page = options.run / "report.html" if options.run.is_dir() else options.run
    wrong = check(program, page.resolve(), options.out)
    print(*wrong, sep="\n")
    return 1 if wrong else 0


if __name__ == "__main__":
    sys.exit(main())
