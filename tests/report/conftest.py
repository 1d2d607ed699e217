import pytest

from flowlik import report
from flowlik.report import _style as style
from tests.report.fake_run import write_run


@pytest.fixture(scope="session", autouse=True)
def coarse():
    """Fewer pixels: drawing is most of what these tests do."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(style, "DPI", 60)
        yield


@pytest.fixture(scope="session")
def built(coarse, tmp_path_factory):
    run = write_run(tmp_path_factory.mktemp("report") / "run")
    report.build(run)
    return run
