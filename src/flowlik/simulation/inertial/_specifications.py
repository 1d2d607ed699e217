"""Models of sensors and attacks from words, as the command line takes them: NAME:option=value,..."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import fields, replace
from typing import Any, TypeVar

from flowlik.errors import DataError
from flowlik.simulation.inertial._gps import GPS_PRESETS, GpsModel
from flowlik.simulation.inertial._imu import IMU_PRESETS, ImuModel
from flowlik.simulation.inertial._spoofing import CarryOff, Jump, Replay, Spoofing
from flowlik.support.files import numbers

ATTACKS: dict[str, type[Jump] | type[CarryOff] | type[Replay]] = {
    "jump": Jump,
    "ramp": CarryOff,
    "replay": Replay,
}
"""Kinds of spoofing by name."""

_Model = TypeVar("_Model", ImuModel, GpsModel)


def imu_model(text: str) -> ImuModel:
    """IMU of a preset's name, with changes: ``adis16448:rate_hz=240,position_c_m=0.1/0/0.05``.

    Raises
    ------
    DataError
        If the preset or an option is unknown, or a value is none.
    """
    return _changed(IMU_PRESETS, text, "IMU")


def gps_model(text: str) -> GpsModel:
    """GPS receiver of a preset's name, with changes: ``coloured:rate_hz=10,outages_s=20/40``.

    Raises
    ------
    DataError
        If the preset or an option is unknown, or a value is none.
    """
    return _changed(GPS_PRESETS, text, "GPS")


def spoofing(text: str) -> Spoofing:
    """Attack of a kind with its values: ``ramp:onset_s=20,rate_mps=0.5``.

    Raises
    ------
    DataError
        If the kind or an option is unknown, one is missing, or a value is none.
    """
    kind, _, rest = text.partition(":")
    if kind not in ATTACKS:
        raise DataError(f"unknown spoofing {kind!r}: known are {', '.join(ATTACKS)}")
    attack, named = ATTACKS[kind], [field.name for field in fields(ATTACKS[kind])]
    given = {name: _numbers_of(words, 1, text)[0] for name, words in _options(rest, named, text).items()}
    missing = [name for name in named[:2] if name not in given]
    if missing:
        raise DataError(f"{text!r}: {kind} needs {' and '.join(missing)}, as in {kind}:{named[0]}=20,...")
    return attack(**given)


def kind_of(attack: Spoofing) -> str:
    """Name of an attack's kind; of one's own class, that class's."""
    return next((name for name, kind in ATTACKS.items() if type(attack) is kind), type(attack).__name__)


def _changed(presets: Mapping[str, _Model], text: str, what: str) -> _Model:
    name, _, rest = text.partition(":")
    if name not in presets:
        raise DataError(f"unknown {what} {name!r}: known are {', '.join(presets)}")
    model = presets[name]
    changes: dict[str, Any] = {}
    for option, words in _options(rest, list(vars(model)), text).items():
        before = getattr(model, option)
        count = 1 if isinstance(before, float) else len(before) or None
        values = _numbers_of(words, count, text)
        changes[option] = values[0] if isinstance(before, float) else tuple(values)
    return replace(model, **changes)


def _options(rest: str, known: list[str], text: str) -> dict[str, list[str]]:
    """Words between slashes of each option."""
    found: dict[str, list[str]] = {}
    for part in filter(None, rest.split(",")):
        name, _, value = part.partition("=")
        if name not in known:
            raise DataError(f"{text!r}: unknown option {name!r}, known are {', '.join(known)}")
        found[name] = value.split("/")
    return found


def _numbers_of(words: list[str], count: int | None, text: str) -> list[float]:
    if count is not None and len(words) != count:
        raise DataError(f"{text!r}: {'/'.join(words)} has {len(words)} numbers, {count} are needed")
    return numbers(words, repr(text))
