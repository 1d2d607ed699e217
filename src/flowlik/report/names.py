"""What models, estimators, flows and data are called, in figures, tables and on the terminal alike."""

from __future__ import annotations

import re

PAPERS, LEARNED = "paper's", "learned"

_FAMILIES = {
    "lcm": "LCM",
    "laplace-cauchy": "LCM",
    "log-logistic": "log-logistic",
    "gaussian": "Gaussian",
    "laplace": "Laplace",
    "student-t": "Student-t",
    "glc": "GLC",
}
_ESTIMATORS = {
    "ransac": "RANSAC",
    "lcmsac": "LCMSAC",
    "mle": "maximum likelihood",
    "opencv-pnp": "OpenCV",
    "opencv": "OpenCV",
    "poselib": "PoseLib",
    "nominal": "nominal",
    "self-calibrated": "self-calibrated",
    "boresight": "boresight",
    "truth": "truth",
}
_FLOWS = {
    "farneback": "Farnebäck",
    "lucas-kanade": "Lucas–Kanade",
    "lucas-kanade-11": "Lucas–Kanade, window 11",
    "dis": "DIS",
    "horn-schunck": "Horn–Schunck",
}
_WORLDS = {"forest-small": "small forest", "forest-fig8": "figure eight"}
_FLIGHT = re.compile(r"(?P<world>.+?)-(?P<path>[a-z0-9]+(?:-fig8)?)-(?P<speed>[\d.]+)mps-seed\d+")
_POPULATION = re.compile(r"(?P<world>.+)-(?P<kind>calibration|held-out)")


def model_name(family: str, schedule: str | None = None) -> str:
    """Name of an error model: the paper's, the learned one, or its family and what it depends on."""
    family, kind = _known(family, _FAMILIES), schedule or "texture"
    if (family, kind) == ("LCM", "texture"):
        return PAPERS
    if (family, kind) == ("GLC", "index"):
        return LEARNED
    if kind == "texture":
        return "GLC over texture" if family == "GLC" else family
    over = {"index": "learned index", "flow": "flow length", "constant": "one width"}
    return f"{family}, {over.get(kind, kind)}"


def estimator_name(estimator: str, model: str | None = None) -> str:
    """Name of an estimator of motion, with that of the error model behind it where that tells them apart."""
    base, learned = re.fullmatch(r"(.*?)(-index)?", estimator).groups()  # type: ignore[union-attr]
    name = _known(base, _ESTIMATORS)
    model = LEARNED if learned else model
    return f"{name}, {model}" if model and name in ("LCMSAC", "maximum likelihood") else name


def name_of(text: str) -> str:
    """Name of what a figure or a record calls by a word: a model, an estimator, a flow or a data set."""
    family, _, schedule = text.partition(" · ")
    if _plain(family) in map(_plain, _FAMILIES):
        return model_name(family, schedule or None)
    if text in _FLOWS:
        return _FLOWS[text]
    named = estimator_name(text)
    return named if named != text else data_name(text)


def names_of(texts: list[str]) -> list[str]:
    """Names of all that one figure compares: where learned models fly too, the others are the paper's."""
    mixed = any(text.endswith("-index") for text in texts)
    return [
        estimator_name(text, PAPERS) if mixed and text in ("lcmsac", "mle") else name_of(text)
        for text in texts
    ]


def data_name(dataset: str) -> str:
    """Name of a data set; a simulated flight's says its path, speed and world."""
    if found := _POPULATION.fullmatch(dataset):
        kind = "calibration flights, in sample" if found["kind"] == "calibration" else "unseen flights"
        return f"{kind} ({_WORLDS.get(found['world'], found['world'])})"
    if found := _FLIGHT.fullmatch(dataset):
        path, world = (_WORLDS.get(found[key], found[key]) for key in ("path", "world"))
        return f"{path} at {found['speed']} m/s ({world})"
    return dataset


def _plain(text: str) -> str:
    return re.sub(r"[^a-z0-9]", "", text.lower())


def _known(text: str, names: dict[str, str]) -> str:
    return {_plain(key): name for key, name in names.items()}.get(_plain(text), text)
