"""A fixture for tests of whole commands, which are about the chain and not about its quality."""

from functools import partial

import pytest

from flowlik.calibration import _fit, _learn
from flowlik.evaluation.likelihood import _evidence as evidence
from flowlik.evaluation.likelihood._goodness import block_interval
from flowlik.report import _page as page
from flowlik.report import _style as style

DRAWN: dict = {}


def cache_by_kind(render):
    def render_once(kind, data, svg=False):
        if kind not in DRAWN:
            DRAWN[kind] = render(kind, data)
        return DRAWN[kind]

    return render_once


@pytest.fixture(scope="package", autouse=True)
def quick():
    """Fits of few iterations, intervals of few replicates, one figure of few pixels a kind."""
    minimize = _fit.minimize

    def minimize_a_little(*args, options, **keywords):
        return minimize(*args, options={**options, "maxiter": 15}, **keywords)

    with pytest.MonkeyPatch.context() as patch:
        for module in (_fit, _learn):
            patch.setattr(module, "minimize", minimize_a_little)
        patch.setattr("flowlik.calibration.run.choose_smoothing", lambda *_: 1e-5)
        patch.setattr("flowlik.commands._calibrate.BAND_REPLICATES", 2)
        patch.setattr(evidence, "block_interval", partial(block_interval, replicates=5))
        patch.setattr(style, "DPI", 30)
        # drawing takes a second a figure: tests/report looks at each, here one of a kind will do
        patch.setattr(page, "render", cache_by_kind(page.render))
        yield
