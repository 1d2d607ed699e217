"""Gauss-Laplace-Cauchy mixture (GLC): the paper's mixture with a smooth core."""

from __future__ import annotations

from typing import ClassVar

from flowlik.likelihood.families._cauchy import Cauchy
from flowlik.likelihood.families._gaussian import Gaussian
from flowlik.likelihood.families._laplace import Laplace
from flowlik.likelihood.families._mixture import Mixture
from flowlik.likelihood.families.base import LOGIT, ErrorFamily, Parameter


class GaussLaplaceCauchy(Mixture):
    r"""Mixture of a Gaussian, a Laplace and a Cauchy density.

    .. math:: w_G \frac{e^{-z^2 / 2 \sigma^2}}{\sqrt{2 \pi} \sigma}
              + (1 - w_G) \left( v_L \frac{e^{-|z| / b}}{2 b}
              + (1 - v_L) \frac{\gamma}{\pi (\gamma^2 + z^2)} \right)

    Parameters ``sigma``, ``scale`` b and ``gamma`` > 0 [px]; ``w_G`` and ``v_L`` (Laplace's share of what
    the Gaussian leaves) in (0, 1).
    """

    name: ClassVar[str] = "glc"
    parameters: ClassVar[tuple[Parameter, ...]] = (
        *Gaussian.parameters,
        *Laplace.parameters,
        *Cauchy.parameters,
        Parameter("w_G", "1", 0.0, 1.0, LOGIT),
        Parameter("v_L", "1", 0.0, 1.0, LOGIT),
    )
    components: ClassVar[tuple[ErrorFamily, ...]] = (Gaussian(), Laplace(), Cauchy())
    starts: ClassVar[tuple[tuple[float, ...], ...]] = (
        (0.7, 1.5, 3.0, 0.3, 0.6),
        (0.5, 1.0, 2.0, 0.2, 0.5),
        (0.7, 2.0, 8.0, 0.5, 0.7),
    )
