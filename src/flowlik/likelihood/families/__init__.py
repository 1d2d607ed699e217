"""Error families by name; a new one is one file and a line here."""

from flowlik.errors import ModelError
from flowlik.likelihood.families._gauss_laplace_cauchy import GaussLaplaceCauchy
from flowlik.likelihood.families._gaussian import Gaussian
from flowlik.likelihood.families._laplace import Laplace
from flowlik.likelihood.families._laplace_cauchy import LaplaceCauchy
from flowlik.likelihood.families._log_logistic import LogLogistic
from flowlik.likelihood.families._student_t import StudentT
from flowlik.likelihood.families.base import ErrorFamily, Parameter

FAMILIES: dict[str, ErrorFamily] = {
    f.name: f
    for f in (
        LaplaceCauchy(),
        LogLogistic(),
        Gaussian(),
        Laplace(),
        StudentT(),
        GaussLaplaceCauchy(),
    )
}


def error_family(name: str) -> ErrorFamily:
    """Family of a name.

    Raises
    ------
    ModelError
        If there is none of that name.
    """
    if name not in FAMILIES:
        raise ModelError(f"unknown error family {name!r}: known are {', '.join(FAMILIES)}")
    return FAMILIES[name]


__all__ = [
    "FAMILIES",
    "ErrorFamily",
    "GaussLaplaceCauchy",
    "Gaussian",
    "Laplace",
    "LaplaceCauchy",
    "LogLogistic",
    "Parameter",
    "StudentT",
    "error_family",
]
