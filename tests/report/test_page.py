import re
from html import unescape
from html.parser import HTMLParser

import numpy as np
import pytest

from flowlik import report
from flowlik.errors import DataError
from flowlik.report._page import read_arrays
from flowlik.report._tables import tables
from tests.report.fake_run import MAKERS, make, records, write_run

VOID = {"meta", "img", "br", "link", "input", "hr"}


class Reader(HTMLParser):
    """Collects what a page loads and links, and insists that its tags balance."""

    def __init__(self):
        super().__init__()
        self.open, self.sources, self.links, self.tags, self.words = [], [], [], set(), []

    def handle_starttag(self, tag, attributes):
        self.tags.add(tag)
        if tag not in VOID:
            self.open.append(tag)
        for name, value in attributes:
            if name in ("src", "srcset", "data"):
                self.sources.append(value)
            if name == "href":
                self.links.append(value)

    def handle_endtag(self, tag):
        assert self.open.pop() == tag, f"</{tag}> closes another tag, line {self.getpos()[0]}"

    def handle_data(self, text):
        self.words.append(text)


@pytest.fixture(scope="module")
def html(built):
    return (built / "report.html").read_text()


@pytest.fixture(scope="module")
def page(html):
    reader = Reader()
    reader.feed(html)
    reader.close()
    return reader


def test_tags_balance(page):
    assert page.open == []


FRONT = {"figures/front-uncertainty--farneback-test.png", "figures/front-coverage.png"}


def test_page_needs_nothing_but_its_figures(page, html, built):
    assert len(page.sources) == len(set(page.sources)) == len(MAKERS) + len(FRONT)
    assert set(page.sources) == set(page.links)
    assert {f"figures/{path.name}" for path in (built / "figures").iterdir()} == set(page.sources)
    assert "script" not in page.tags and "link" not in page.tags
    assert "data:" not in html and "http" not in html and "@import" not in html and "url(" not in html


def test_two_pictures_stand_first_and_the_rest_is_folded(html):
    first, _, rest = html.partition("</section>")
    assert set(re.findall(r'<img src="([^"]*)"', first)) == FRONT
    assert rest.count('<img loading="lazy"') == len(MAKERS)
    assert "<details open" not in html


def test_page_shows_every_table_value(html):
    text = unescape(html)
    for table in tables(records()):
        for column in table.columns:
            assert column.label in text
        for cell in (cell for row in table.rows for cell in row.cells):
            assert cell.text in text and cell.hint in text
        assert all(note in text for note in table.notes)


def test_page_says_what_was_run_and_what_to_beware_of(page):
    text = " ".join(page.words)
    assert "flowlik reproduce --quick --out 'a & b'" in text
    assert "14 % of <components> lie outside" in text
    assert '"path": "<worlds>"' in text and "numpy 2.4" in text and "Seed 1." in text


def test_text_is_escaped(html):
    assert "<b>thing" not in html and "<components>" not in html and "<worlds>" not in html


def test_rebuilding_gives_the_same_page(tmp_path):
    run = write_run(tmp_path / "run", kinds=["coverage"])
    first = report.build(run).read_bytes()
    assert report.build(run).read_bytes() == first
    assert not list(run.rglob("*.part"))


def test_data_of_no_known_kind_is_a_warning(tmp_path):
    run = write_run(tmp_path / "run", kinds=[])
    np.savez(run / "data" / "pie--chart.npz", a=np.arange(3))
    assert "data/pie--chart.npz is of no known kind" in report.build(run).read_text()


def test_a_run_without_data_or_warnings_has_a_page(tmp_path):
    run = write_run(tmp_path / "run", kinds=[], warnings=[])
    assert 'class="warnings"' not in report.build(run).read_text()


def test_figures_stand_under_their_flow_method(tmp_path):
    run = write_run(tmp_path / "run", kinds=[])
    np.savez(run / "data" / "coverage--kitti-lucas-kanade.npz", **make("coverage"))
    text = report.build(run).read_text()
    assert "<h2>Lucas–Kanade</h2>" in text and '<span class="soft">kitti</span>' in text


def test_figures_of_an_earlier_page_do_not_stay(tmp_path):
    run = write_run(tmp_path / "run", kinds=["coverage", "pit"])
    report.build(run, svg=True)
    assert len(list((run / "figures").glob("*.svg"))) == 2
    (run / "data" / "pit--farneback-test.npz").unlink()
    report.build(run)
    names = {path.name for path in (run / "figures").iterdir()}
    assert names == {"coverage--farneback-test.png", "front-coverage.png"}


def one_line(error):
    return "\n" not in str(error.value)


@pytest.mark.parametrize("missing", ["run", "run.json", "metrics.json"])
def test_what_is_no_run_folder_is_refused(tmp_path, missing):
    run = write_run(tmp_path / "run", kinds=[])
    path = run if missing == "run" else run / missing
    path.rename(tmp_path / "elsewhere")
    with pytest.raises(DataError) as error:
        report.build(run)
    assert one_line(error)


@pytest.mark.parametrize("text", ["[]", "{", '{"warnings": "one"}', '{"warnings": [1]}', '{"versions": []}'])
def test_invalid_run_json_is_refused(tmp_path, text):
    run = write_run(tmp_path / "run", kinds=[])
    (run / "run.json").write_text(text)
    with pytest.raises(DataError, match=r"run\.json") as error:
        report.build(run)
    assert one_line(error)


def corrupt(content):
    middle = len(content) // 2
    return [b"", b"not an npz", content[:middle], content[:middle] + b"\0" * 40 + content[middle + 40 :]]


@pytest.mark.parametrize("damage", range(4))
def test_a_corrupt_npz_is_refused(tmp_path, damage):
    run = write_run(tmp_path / "run", kinds=["coverage"])
    path = next((run / "data").iterdir())
    path.write_bytes(corrupt(path.read_bytes())[damage])
    with pytest.raises(DataError, match="coverage--farneback-test") as error:
        report.build(run)
    assert one_line(error)
    assert not (run / "report.html").exists()


def test_pickled_arrays_are_refused(tmp_path):
    np.savez(tmp_path / "a.npz", a=np.array([{}], dtype=object))
    with pytest.raises(DataError, match=r"a\.npz"):
        read_arrays(tmp_path / "a.npz")


def test_an_array_that_does_not_fit_names_its_file(tmp_path):
    run = write_run(tmp_path / "run", kinds=[])
    np.savez(run / "data" / "coverage--x.npz", nominal=np.arange(3))
    with pytest.raises(DataError, match=r"coverage--x\.npz: figure coverage lacks names, observed"):
        report.build(run)
