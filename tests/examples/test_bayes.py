import numpy as np

from examples import bayes_recursion


def test_the_recursion_is_better_than_pairs_on_their_own():
    recursion, alone = np.median(bayes_recursion.main(10)[2:], axis=0)
    assert recursion < alone
    assert recursion < 2e-3
