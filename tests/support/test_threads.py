import numpy as np
import pytest

from flowlik.support import threads


@pytest.mark.parametrize("workers", [1, 2, 4])
@pytest.mark.parametrize(("rows", "band"), [(0, 5), (4, 5), (5, 5), (23, 5), (10, 1)])
def test_bands_cover_every_row_once(monkeypatch, workers, rows, band):
    monkeypatch.setattr(threads, "THREADS", workers)
    times = np.zeros(rows, int)

    def work(first, last):
        assert 0 < last - first <= band
        times[first:last] += 1

    threads.in_bands(work, rows, band)
    assert (times == 1).all()


@pytest.mark.parametrize("workers", [1, 2])
def test_an_error_in_a_band_is_not_lost(monkeypatch, workers):
    monkeypatch.setattr(threads, "THREADS", workers)
    with pytest.raises(ZeroDivisionError):
        threads.in_bands(lambda first, last: 1 // (first - 2), 6, 2)
