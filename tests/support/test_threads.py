import threading

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


def test_a_map_works_one_item_ahead():
    taken, begun = [], [threading.Event() for _ in range(4)]

    def items():
        for i in range(3):
            taken.append(i)
            yield i

    def work(i):
        begun[i].set()
        return threading.current_thread(), i * i

    found = threads.map_ahead(work, items())
    assert taken == []
    for i, (thread, square) in enumerate(found):
        assert square == i * i
        assert thread is not threading.current_thread()
        assert taken == list(range(min(i + 2, 3)))
        assert i == 2 or begun[i + 1].wait(10)


def test_an_error_ahead_comes_in_its_turn():
    found = threads.map_ahead(lambda i: 1 // (1 - i), range(3))
    assert next(found) == 1
    with pytest.raises(ZeroDivisionError):
        next(found)
