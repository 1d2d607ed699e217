"""FlowLikelihood files: JSON with everything a table needs to be used rightly."""

from __future__ import annotations

from pathlib import Path
from typing import Any, Literal

import numpy as np
from pydantic import BaseModel, ConfigDict, Field, ValidationError, model_validator

from flowlik.errors import FlowlikError, ModelError
from flowlik.flow import check_record
from flowlik.image.texture import TextureDefinition
from flowlik.likelihood.families import error_family
from flowlik.likelihood.likelihood import Errors, FlowLikelihood
from flowlik.likelihood.schedule import Schedule, index_of_values, index_values
from flowlik.likelihood.shared_errors import SharedErrors
from flowlik.likelihood.shipped import serving, shipped
from flowlik.support.files import atomic_write


class _Strict(BaseModel):
    model_config = ConfigDict(extra="forbid", allow_inf_nan=False)


class _Input(_Strict):
    covariate: str
    low: float = Field(gt=0)
    high: float | None = None


class _Term(_Strict):
    covariates: list[str] = Field(min_length=1)
    weight: float


class _Index(_Strict):
    inputs: list[_Input] = Field(min_length=1)
    terms: list[_Term] = Field(min_length=1)
    offset: float
    low: float
    high: float


class _Texture(_Strict):
    derivative: str
    window: int


class _Persistence(_Strict):
    share: float
    memory_s: float


class _OverTime(_Strict):
    full: _Persistence
    given_rotation: _Persistence


class _SharedErrors(_Strict):
    correlation: dict[str, list[float]] | None = None
    composite_power: float = 0.0
    over_time: _OverTime | None = None


class ModelFile(_Strict):
    """Layout of a model file, schema version 3.

    ``index`` says how covariates give x (ln of texture for the paper's schedule), ``knots`` are of x;
    ``table`` maps each parameter of the family to its values at the knots, linear
    between; ``shared_errors`` are what the errors of an image have in common
    (`flowlik.likelihood.shared_errors`); ``residual`` says which errors it was calibrated on
    (`flowlik.likelihood.likelihood.FlowLikelihood`), both components where a file does not tell. Files of
    version 2 are read.
    """

    schema_version: Literal[3] = 3
    family: str
    interpolation: Literal["parameter"] = "parameter"
    index: _Index
    knots: list[float]
    table: dict[str, list[float]]
    texture: _Texture
    flow: dict[str, Any]
    provenance: dict[str, Any]
    goodness: dict[str, Any]
    shared_errors: _SharedErrors = _SharedErrors()
    residual: Literal["depth", "epipolar"] = "depth"

    @model_validator(mode="before")
    @classmethod
    def _of_version_2(cls, content: Any) -> Any:
        """Version 2 had the parts of shared errors on their own, the power under another name."""
        if not isinstance(content, dict) or content.get("schema_version") != 2:
            return content
        content = {**content, "schema_version": 3}
        shared = {
            "correlation": content.pop("score_correlation", None),
            "composite_power": content.pop("emphasis", 0.0),
        }
        return {**content, "shared_errors": shared}


def save_likelihood(likelihood: FlowLikelihood, path: Path | str) -> None:
    """Write a calibrated likelihood as JSON, atomically.

    Raises
    ------
    ModelError
        If the likelihood belongs to no flow method.
    """
    if likelihood.method is None:
        raise ModelError("a likelihood without a flow method cannot be saved")
    schedule = likelihood.schedule
    content = ModelFile(
        family=likelihood.family.name,
        index=_Index.model_validate(index_values(schedule.index)),
        knots=schedule.knots.tolist(),
        table={p.name: row.tolist() for p, row in zip(likelihood.family.parameters, schedule.values)},
        texture=_Texture.model_validate(likelihood.texture.describe()),
        flow=likelihood.method,
        provenance=likelihood.provenance,
        goodness=likelihood.goodness,
        shared_errors=_SharedErrors.model_validate(likelihood.shared_errors.values()),
        residual=likelihood.residual,
    )
    with atomic_write(Path(path)) as file:
        file.write(content.model_dump_json(indent=1) + "\n")


def find_model(name: Path | str, residual: Errors | None = None) -> Path:
    """File of a shipped model's name, or the path itself; an existing file goes before a name.

    A shipped name may stand for two tables: with a residual, it is the one of that residual's errors.

    Raises
    ------
    ModelError
        If it is neither.
    """
    path = Path(name)
    if path.exists() or path.suffix or len(path.parts) != 1:
        return path
    if path.name not in shipped():
        raise ModelError(f"{path}: neither a model file nor a shipped model ({', '.join(shipped())})")
    return shipped()[serving(path.name, residual)]


def load_likelihood(path: Path | str, residual: Errors | None = None) -> FlowLikelihood:
    """Read a likelihood from its JSON file, or the shipped one of a name such as ``"lucas-kanade"``.

    Parameters
    ----------
    path : Path or str
        File or name; a file goes before a name.
    residual : {"depth", "epipolar"}, optional
        What it shall serve. Without depth (``"epipolar"``) a shipped name is its table of errors across
        epipolar lines, where there is one; by default it is the one that serves everything.

    Raises
    ------
    ModelError
        If the file is missing, is not a model file, or its contents contradict one another.
    """
    path = find_model(path, residual)
    try:
        content = ModelFile.model_validate_json(path.read_bytes())
        family = error_family(content.family)
        names = [p.name for p in family.parameters]
        if sorted(content.table) != sorted(names):
            raise ModelError(
                f"family {family.name} needs the parameters {names}, not {sorted(content.table)}"
            )
        if len({len(content.knots), *map(len, content.table.values())}) != 1:
            raise ModelError("knots and parameters differ in number")
        return FlowLikelihood(
            family,
            Schedule(
                index_of_values(content.index.model_dump()),
                np.array(content.knots, dtype=np.float64),
                np.array([content.table[name] for name in names], dtype=np.float64),
            ),
            TextureDefinition(content.texture.derivative, content.texture.window),
            check_record(content.flow),
            content.provenance,
            content.goodness,
            SharedErrors.of_values(content.shared_errors.model_dump()),
            content.residual,
        )
    except OSError as error:
        raise ModelError(f"{path}: cannot read the model file ({error.strerror or error})") from None
    except ValidationError as error:
        first = error.errors()[0]
        where = ".".join(str(part) for part in first["loc"]) or "the file"
        raise ModelError(f"{path}: not a flowlik model file ({where}: {first['msg']})") from None
    except FlowlikError as error:
        raise ModelError(f"{path}: {error}") from None
