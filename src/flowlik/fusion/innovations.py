"""What every GPS fix told a smoother that it did not know: the input of a monitor of GPS."""

from __future__ import annotations

from dataclasses import dataclass

from flowlik.support.arrays import Array

ATTITUDE, VELOCITY, POSITION, GYROSCOPE_BIAS, ACCELEROMETER_BIAS, GPS_BIAS = (
    slice(3 * i, 3 * i + 3) for i in range(6)
)
"""Places in the error state: truth minus estimate.

Attitude [rad] is the right perturbation ``R_n_b exp(theta)``, thus in the body's axes, which are the IMU's;
velocity [m/s] and position [m] of the body are in {n}; biases of gyroscope [rad/s] and accelerometer [m/s²]
in {b}; where GPS has coloured errors, their bias in {n} comes last, in the unit that `observations` turns
into metres: the smoother's is the standard deviation that a fix states for it.
"""


@dataclass(frozen=True, eq=False)
class GpsInnovations:
    """Innovations of N fixes, and how each shift of a fix goes on into later ones.

    The error state has n = 15 entries, or 18 with a bias of GPS (`ATTITUDE` ... `GPS_BIAS`). Let fix k be
    shifted by ``f[k]`` [m]. With the shift ``d[k]`` of the state's estimate before fix k, and d[0] = 0, the
    innovation is shifted by ``s[k] = f[k] - observations[k] @ d[k]``, the estimate after the fix by
    ``d[k] + gains[k] @ s[k]``, and before the next by ``transitions[k + 1]`` times that. Honest
    innovations have mean 0, their stated covariance, and are independent of one another.

    Attributes
    ----------
    times_s : array (N,)
        Times [s] of the fixes, increasing.
    innovations_m : array (N, 3)
        Measured minus predicted position [m] of the antenna in {n}, before the fix is used.
    innovation_covariances_m2 : array (N, 3, 3)
        Its covariance [m²]: of prediction and fix together.
    observations : array (N, 3, n)
        Derivative of the measured position by the error state.
    gains : array (N, n, 3)
        By how much the estimate moves for a metre of innovation.
    transitions : array (N, n, n)
        From a shift of the estimate just after fix k-1 to that just before fix k: through the IMU, and
        through what flow corrects between. Of the first fix the identity.
    """

    times_s: Array
    innovations_m: Array
    innovation_covariances_m2: Array
    observations: Array
    gains: Array
    transitions: Array
