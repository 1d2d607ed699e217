import subprocess
import sys
import xml.etree.ElementTree as ET

import numpy as np
import pytest

from flowlik import report
from flowlik.errors import DataError
from flowlik.report._draw_calibration import _magnitude_quantile, draw_distributions, draw_table
from flowlik.report._draw_motion import _widest_axes
from flowlik.report._figures import caption, check, render
from flowlik.report._hue import flow_scale, hue_colours
from flowlik.report._kinds import FIGURES
from flowlik.report._style import grouped, looks, nice
from flowlik.report.names import data_name
from tests.report.fake_run import MAKERS, make

PNG = b"\x89PNG\r\n\x1a\n"


def test_every_kind_has_data_to_test_it():
    assert set(MAKERS) == set(FIGURES)


@pytest.mark.parametrize("kind", FIGURES)
def test_every_kind_is_drawn_as_png(built, kind):
    png = (built / "figures" / f"{kind}--farneback-test.png").read_bytes()
    assert png.startswith(PNG) and len(png) > 2_000


@pytest.mark.parametrize("kind", ["coverage", "uncertainty"])
def test_drawing_twice_gives_equal_bytes(built, kind):
    again, vector = (render(kind, make(kind), svg=svg) for svg in (False, True))
    assert again.png == vector.png == (built / "figures" / f"{kind}--farneback-test.png").read_bytes()
    assert vector.svg == render(kind, make(kind), svg=True).svg and not again.svg
    assert ET.fromstring(vector.svg).tag.endswith("svg")


@pytest.mark.parametrize("kind", ["goodness", "pit", "levels", "coverage", "sparsification", "frame-errors"])
def test_no_legend_hides_a_curve(kind):
    figure = FIGURES[kind].draw(make(kind))
    assert len(figure.legends) == 1
    assert not any(ax.get_legend() for ax in figure.axes)


def test_the_linear_panels_of_distributions_show_the_middle_of_the_errors():
    data = make("distributions")
    linear, logarithmic = draw_distributions(data).axes[:2]
    assert 1 < linear.get_xlim()[1] < 12 < logarithmic.get_xlim()[1]  # a scale of 3 px, tails beyond


def test_importing_the_report_loads_no_plotting_library():
    code = "import sys, flowlik.report; print({'matplotlib', 'jinja2'} & set(sys.modules))"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.strip() == "set()"


@pytest.mark.parametrize("kind", ["uncertainty", "flow-sequence"])
def test_sparse_flow_is_drawn(kind):
    assert render(kind, make(kind, sparse=True)).png.startswith(PNG)


def test_unknown_everywhere_is_drawn():
    data = make("uncertainty")
    data["flow"], data["half_width"] = np.full((24, 36, 2), np.nan), np.full((24, 36, 2), np.nan)
    assert render("uncertainty", data).png.startswith(PNG)


def test_trajectory_without_truth_and_with_gaps_is_drawn():
    data = make("trajectories")
    del data["truth"], data["unsolved"]
    data["positions"][0, 50:] = np.nan
    assert render("trajectories", data).png.startswith(PNG)


@pytest.mark.parametrize("kind", FIGURES)
def test_each_missing_array_is_named(kind):
    for name in FIGURES[kind].required:
        data = make(kind)
        del data[name]
        with pytest.raises(DataError, match=f"lacks {name}"):
            check(kind, data)


def test_shapes_that_disagree_are_named():
    data = make("coverage")
    data["observed"] = data["observed"][:, :-1]
    with pytest.raises(DataError, match=r"observed has shape \(3, 4\), expected \(F, C\)"):
        render("coverage", data)
    data = make("error-over-texture")
    data["error_edges"] = data["error_edges"][:-1]
    with pytest.raises(DataError, match="counts has shape"):
        render("error-over-texture", data)


def test_values_that_cannot_be_drawn_are_a_data_error():
    data = make("coverage")
    data["observed"] = np.full(data["observed"].shape, "words")
    with pytest.raises(DataError, match="figure coverage cannot be drawn"):
        render("coverage", data)


def test_unknown_kind_names_the_known_ones():
    with pytest.raises(DataError, match=r"no figure of kind 'pie'.*goodness"):
        render("pie", {})


def test_save_figure_writes_both_files(tmp_path):
    png, svg = report.save_figure("coverage", make("coverage"), tmp_path / "new" / "a.b")
    assert png.name == "a.b.png" and svg.name == "a.b.svg" and png.stat().st_size and svg.stat().st_size


def test_caption_states_the_confidence():
    assert "90%" in caption("uncertainty", make("uncertainty"))


def test_hue_is_direction_and_saturation_is_length():
    right, left, still, unknown = hue_colours(np.array([[2.0, 0], [-2, 0], [0, 0], [np.nan, 0]]), 2.0)
    assert right[0] > 0.8 and right[1] < 0.05 and right[2] < 0.05  # red
    assert left[0] < 0.05 and left[1] > 0.8 and left[2] > 0.8  # cyan
    assert np.array_equal(still, [1, 1, 1])
    assert np.ptp(unknown) == 0 and 0 < unknown[0] < 1


def test_flow_scale_ignores_the_unknown():
    assert flow_scale(np.full((3, 3, 2), np.nan)) == 1
    assert flow_scale(np.array([[3.0, 4.0], [np.nan, 0]])) == pytest.approx(5)


def test_magnitude_quantile_interpolates_within_a_bin():
    edges = np.array([0.1, 1.0, 10.0])
    counts = np.array([[10.0, 10.0], [0.0, 10.0], [0.0, 0.0]])
    median = _magnitude_quantile(edges, counts, 0.5)
    assert median[:2] == pytest.approx([1.0, np.sqrt(10)]) and np.isnan(median[2])


def test_widest_axes_prefer_the_ground_plane():
    assert _widest_axes(np.zeros((4, 3))) == (0, 2)
    assert _widest_axes(np.array([[0, 0, 0], [1.0, 5, 2]])) == (1, 2)


def test_looks_are_the_same_however_a_name_is_spelled():
    lcm, loglogistic, other, second = looks(["LCM", "log_logistic", "opencv", "poselib"])
    assert lcm == looks(["laplace-cauchy"])[0] and loglogistic.label == "log-logistic"
    assert len({lcm.colour, loglogistic.colour, other.colour, second.colour}) == 4


def test_models_have_the_names_that_a_reader_knows():
    names = ["lcm · texture", "lcm", "glc · index", "gaussian · texture", "glc · texture", "lcm · flow"]
    labels = [look.label for look in looks(names)]
    assert labels == ["paper's", "paper's", "learned", "Gaussian", "GLC over texture", "LCM, flow length"]
    flown = [look.label for look in looks(["lcmsac", "lcmsac-index", "opencv-pnp"])]
    assert flown == ["LCMSAC, paper's", "LCMSAC, learned", "OpenCV"]
    assert [look.label for look in looks(["lcmsac", "ransac"])] == ["LCMSAC", "RANSAC"]
    assert data_name("forest-small-curve-9mps-seed101") == "curve at 9 m/s (small forest)"
    assert data_name("forest-small-calibration") == "calibration flights, in sample (small forest)"
    assert data_name("KITTI-03") == "KITTI-03"


def test_a_table_over_an_index_says_so():
    data = make("table") | {"coordinate": np.array("index")}
    labels = [draw_table(data).axes[0].get_xlabel() for data in (data, make("table"))]
    assert "px" in labels[0] and "texture" in labels[1]


def test_bands_and_a_floor_are_drawn():
    table = make("table")
    table |= {"low": table["values"] * 0.9, "high": table["values"] * 1.1}
    goodness = make("goodness")
    goodness["floor"] = np.full(len(goodness["texture"]), 0.01)
    for kind, data in (("table", table), ("goodness", goodness)):
        assert render(kind, data).png != render(kind, make(kind)).png


@pytest.mark.parametrize(("value", "expected"), [(1, 1), (0.99, 0.5), (49, 20), (0, 1), (np.nan, 1)])
def test_nice_rounds_down(value, expected):
    assert nice(value) == pytest.approx(expected)


def test_grouped_keeps_numbers_readable():
    assert [grouped(v) for v in (0.1, 30, 5000, 1e9)] == ["0.1", "30", "5 000", "1e+09"]
