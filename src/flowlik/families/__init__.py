"""Error families by name; a new one is one file and a line here."""

from flowlik.errors import ModelError
from flowlik.families.base import ErrorFamily, Parameter
from flowlik.families.gaussian import Gaussian
from flowlik.families.laplace_cauchy import LaplaceCauchy
from flowlik.families.log_logistic import LogLogistic

FAMILIES: dict[str, ErrorFamily] = {f.name: f for f in (LaplaceCauchy(), LogLogistic(), Gaussian())}


def error_family(name: str) -> ErrorFamily:
    """Family of a name; ModelError names the known ones."""
    if name not in FAMILIES:
        raise ModelError(f"unknown error family {name!r}: known are {', '.join(FAMILIES)}")
    return FAMILIES[name]


__all__ = ["FAMILIES", "ErrorFamily", "Gaussian", "LaplaceCauchy", "LogLogistic", "Parameter", "error_family"]
