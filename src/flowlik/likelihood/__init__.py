"""Error distributions of flow: families, schedules, tables, shared errors, model files, shipped models.

Names load on first use: what the shell offers on the tab key needs no more than the names of shipped models.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from flowlik.support.lazy import lazily

if TYPE_CHECKING:
    from flowlik.likelihood.families import ErrorFamily as ErrorFamily
    from flowlik.likelihood.families import Gaussian as Gaussian
    from flowlik.likelihood.families import LaplaceCauchy as LaplaceCauchy
    from flowlik.likelihood.families import error_family as error_family
    from flowlik.likelihood.likelihood import FlowLikelihood as FlowLikelihood
    from flowlik.likelihood.model_file import load_likelihood as load_likelihood
    from flowlik.likelihood.model_file import save_likelihood as save_likelihood
    from flowlik.likelihood.schedule import Index as Index
    from flowlik.likelihood.schedule import Input as Input
    from flowlik.likelihood.schedule import Schedule as Schedule
    from flowlik.likelihood.schedule import Term as Term

__all__, __getattr__, __dir__ = lazily(
    __name__,
    {
        "families": "ErrorFamily Gaussian LaplaceCauchy error_family",
        "likelihood": "FlowLikelihood",
        "model_file": "load_likelihood save_likelihood",
        "schedule": "Index Input Schedule Term",
    },
)
