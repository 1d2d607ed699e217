"""A run folder made of synthetic arrays, one figure of every kind."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np

from flowlik.results.records import Record, write_records
from flowlik.support.files import write_json


def flow_pair(rng, H=24, W=36, sparse=False):
    v, u = np.mgrid[:H, :W].astype(float)
    image = (128 + 80 * np.sin(u / 3) * np.cos(v / 5) + 8 * rng.standard_normal((H, W))).clip(0, 255)
    flow = np.stack([2 + np.sin(v / 9), np.cos(u / 7)], axis=-1).astype(np.float32)
    if sparse:
        keep = rng.random((H, W)) < 0.04
        keep[3, 4] = True
        flow[~keep] = np.nan
    else:
        flow[:2] = np.nan
    return image.astype(np.uint8), flow


def uncertainty(rng, H=24, W=36, sparse=False):
    image, flow = flow_pair(rng, H, W, sparse)
    small = np.exp(rng.normal(-1, 1, (H, W)))
    half_width = np.stack([small, small * np.exp(rng.uniform(0, 4, (H, W)))], axis=-1)
    half_width[np.isnan(flow).any(axis=-1)] = np.nan
    angle = rng.uniform(-np.pi, np.pi, (H, W))
    return {
        "image": image,
        "flow": flow,
        "half_width": half_width,
        "angle": angle,
        "confidence": np.array(0.9),
    }


def flow_sequence(rng, n=3, **options):
    pairs = [flow_pair(rng, **options) for _ in range(n)]
    images, flows = (np.stack(part) for part in zip(*pairs))
    return {"images": images, "true_flow": flow_pair(rng, **options)[1] + 0 * flows, "flow": flows}


def error_over_texture(rng, X=56, Z=140):
    texture, error = np.logspace(-2, 5, X + 1), np.logspace(-4, 3, Z + 1)
    t, z = np.log(texture[1:])[:, None], np.log(error[1:])
    spread = np.exp(-(((z + 0.25 * t) / 1.2) ** 2) - ((t - 4) / 3) ** 2)
    bound = 8 * texture**-0.22
    return {
        "texture_edges": texture,
        "error_edges": error,
        "counts": rng.poisson(1e4 * spread).astype(np.int64),
        "bound_texture": texture,
        "bound_90": bound,
    }


def table(rng, M=12):
    knots = np.logspace(-1, 4.5, M)
    steps = np.linspace(0, 1, M)
    return {
        "knots": knots,
        "values": np.stack([0.3 + 0.6 * steps, 10 ** (1 - 3 * steps), 0.4 + 0.4 * np.sin(3 * steps)], axis=1),
        "names": np.array(["beta", "gamma", "w_L"]),
        "units": np.array(["1", "px", "1"]),
        "edges": np.logspace(-2, 5, 57),
        "counts": (1e5 * np.exp(-(np.linspace(-3, 2, 56) ** 2))).astype(np.int64),
    }


def distributions(rng, L=3, B=181):
    z = np.tile(np.sinh(np.linspace(-8, 8, B)) / 100, (L, 1))
    scale = np.array([3.0, 0.8, 0.2, 0.06, 0.03])[:L, None]
    fitted = 0.6 * np.exp(-np.abs(z) / scale) / (2 * scale) + 0.4 * scale / np.pi / (scale**2 + z**2)
    empirical = fitted * rng.gamma(60, 1 / 60, z.shape)
    edges = np.array([[0.1, 1], [10, 30], [300, 500], [5e3, 1e4], [2e4, 3e4]])[:L]
    return {"level_edges": edges, "z": z, "empirical": empirical, "fitted": fitted}


def goodness(rng, X=40):
    texture = np.logspace(-1, 4, X)
    ks = np.array([[0.02], [0.05], [0.28]]) * rng.gamma(20, 1 / 20, (3, X))
    ks[:, 0] = np.nan
    counts = (1e6 * np.exp(-(np.linspace(-3.5, 3, X) ** 2))).astype(np.int64)
    families = np.array(["lcm", "log-logistic", "gaussian"])
    return {"texture": texture, "families": families, "ks": ks, "counted": counts > 1e4, "counts": counts}


def coverage(rng):
    nominal = np.array([0.5, 0.68, 0.9, 0.95, 0.99])
    observed = np.clip([nominal + 0.005, nominal - 0.03, nominal + 0.2 * (1 - nominal)], 0, 1)
    return {"nominal": nominal, "names": np.array(["lcm", "log-logistic", "gaussian"]), "observed": observed}


def levels(rng, X=40):
    texture = np.logspace(-1, 4, X)
    covered = 0.9 + 0.03 * rng.standard_normal((2, X))
    covered[:, 0] = np.nan
    return {
        "texture": texture,
        "names": np.array(["lcm · index", "lcm · texture"]),
        "coverage": np.clip(covered, 0, 1),
        "nll": 1 - 0.1 * np.log(texture) + rng.normal(0, 0.05, (2, X)),
        "counted": np.tile(np.arange(X) > 8, (2, 1)),
        "confidence": np.array(0.9),
    }


def pit(rng, B=20):
    density = np.array([[1.0], [1.0]]) + rng.normal(0, [[0.02], [0.3]], (2, B))
    return {"edges": np.linspace(0, 1, B + 1), "names": np.array(["glc", "gaussian"]), "density": density}


def sparsification(rng, G=100):
    removed = np.linspace(0, 0.99, G)
    oracle = np.tile((1 - removed) ** 2, (2, 2, 1))
    return {
        "removed": removed,
        "names": np.array(["lcm", "gaussian"]),
        "statistics": np.array(["mean", "median"]),
        "curves": oracle + np.array([0.3, 0.6])[:, None, None] * removed,
        "oracle": oracle,
        "ause": np.array([[0.15, 0.15], [0.3, 0.3]]),
    }


def bias(rng, X=40):
    texture = np.logspace(-1, 4, X)
    size = texture**-0.4
    return {
        "texture": texture,
        "negative": 0.5 + 0.3 / (1 + texture),
        "median": -size / (1 + texture),
        "mean": -size / (2 + texture) + 0.1 * rng.standard_normal(X),
        "median_magnitude": size,
        "counts": (1e6 * np.exp(-(np.linspace(-3.5, 3, X) ** 2))).astype(np.int64),
    }


def eigenbasis(rng, R=8):
    return {
        "ratio_edges": np.linspace(0, 1, R + 1),
        "counts": np.linspace(1e5, 1e3, R),
        "names": np.array(["as it is", "pooled"]),
        "nll": 1 + 0.01 * rng.standard_normal((2, R)),
        "ks": 0.05 + 0.01 * rng.random((2, R)),
    }


def trajectories(rng, N=120):
    s = np.linspace(0, 2 * np.pi, N)
    truth = np.stack([20 * np.sin(2 * s), 0.3 * np.sin(s), 40 * np.sin(s)], axis=1)
    walk = np.cumsum(rng.normal(0, 0.1, (2, N, 3)), axis=1) * np.array([1.5, 0.6])[:, None, None]
    return {
        "names": np.array(["ransac", "lcmsac"]),
        "positions": truth + walk,
        "timestamps": np.linspace(0, 12, N),
        "truth": truth,
        "unit": np.array("m"),
        "unsolved": rng.random((2, N)) < 0.03,
    }


def frame_errors(rng, N=120):
    size = np.array([[1.0], [0.6], [0.4]])
    return {
        "names": np.array(["ransac", "lcmsac", "mle"]),
        "translation": 0.01 * size * rng.gamma(2, 1, (3, N)),
        "rotation": 0.05 * size * rng.gamma(2, 1, (3, N)),
        "timestamps": np.linspace(0, 12, N),
    }


def segment_errors(rng):
    return {
        "names": np.array(["nominal", "poselib"]),
        "lengths": np.arange(100.0, 400.0, 100.0),
        "speeds": np.arange(5.0, 13.0, 2.0),
        **{f"{kind}_by_length": rng.gamma(2, 0.2, (2, 3)) for kind in ("translation", "rotation")},
        **{f"{kind}_by_speed": rng.gamma(2, 0.2, (2, 4)) for kind in ("translation", "rotation")},
    }


def intrinsics(rng, N=60):
    sigma = np.array([4.0, 0.02]) / np.sqrt(1 + np.arange(N))[:, None]
    return {
        "names": np.array(["cx", "k1"]),
        "timestamps": np.arange(N) / 10,
        "values": sigma * rng.standard_normal(2),
        "sigma": sigma,
    }


def outliers(rng, H=24, W=36, V=20):
    return {
        "image": rng.integers(0, 256, (H, W)).astype(np.uint8),
        "pixels": rng.uniform([0, 0], [W, H], (V, 2)),
        "flow": rng.normal(0, 2, (V, 2)),
        "inlier": np.arange(V) % 4 > 0,
    }


def gauntlet(rng, S=6, C=4):
    rates = rng.choice([0.0, 0.001, 0.05, 0.6, np.nan], (2, S, C))
    return {
        "situations": np.array([f"situation-{k}" for k in range(S)]),
        "columns": np.array(["LK, depth", "DIS, depth", "LK, one camera", "DIS, one camera"]),
        "estimators": np.array(["lcmsac", "opencv"]),
        "rates": rates,
    }


def without_truth(rng, B=12, L=4, F=5):
    found = np.exp(np.linspace(-4, 1, B))
    levels = np.array([0.5, 0.68, 0.9, 0.95])
    coverage = np.clip(levels[None, :, None] + rng.normal(0.03, 0.02, (2, L, F)), 0, 1)
    return {
        "names": np.array(["before", "after"]),
        "predicted": np.stack([1.6 * found, found * np.exp(rng.normal(0, 0.05, B))]),
        "found": np.stack([found, found]),
        "levels": levels,
        "by_size": coverage,
        "by_texture": coverage,
    }


def innovations(rng, G=30):
    t = np.arange(G) / 5
    sigma = np.full((G, 3), 1.6)
    values = sigma * rng.standard_normal((G, 3))
    return {
        "timestamps": t,
        "innovations": values,
        "sigma": sigma,
        "nis": ((values / sigma) ** 2).sum(axis=1),
        "statistic": np.cumsum(rng.random(G)),
        "threshold": np.array(12.0),
        "alarm": np.array([4.8, 2.0, 2.6]),
    }


def biases(rng, N=40):
    sigma = np.outer(1 / np.sqrt(1 + np.arange(N)), [0.01] * 3 + [0.1] * 3)
    return {"timestamps": np.arange(N) / 10, "values": sigma * rng.standard_normal(6), "sigma": sigma}


def contributions(rng, N=40):
    grown = np.array([1.0, 2.0, 4.0])[:, None] * (0.01 + 0.02 * rng.random(N))
    names = np.array(["all", "without flow", "without GPS"])
    parts = {part: grown for part in ("attitude", "velocity", "position")}
    return {"timestamps": np.arange(N) / 10, "names": names, **parts}


MAKERS = {
    "uncertainty": uncertainty,
    "flow-sequence": flow_sequence,
    "error-over-texture": error_over_texture,
    "table": table,
    "without-truth": without_truth,
    "distributions": distributions,
    "goodness": goodness,
    "coverage": coverage,
    "levels": levels,
    "pit": pit,
    "sparsification": sparsification,
    "bias": bias,
    "eigenbasis": eigenbasis,
    "trajectories": trajectories,
    "innovations": innovations,
    "biases": biases,
    "contributions": contributions,
    "frame-errors": frame_errors,
    "segment-errors": segment_errors,
    "intrinsics": intrinsics,
    "outliers": outliers,
    "gauntlet": gauntlet,
}


def make(kind, seed=0, **options):
    return MAKERS[kind](np.random.default_rng(seed), **options)


def records():
    fit = Record(
        "ks_median", 0.0213, "", "planes", "farneback", "lcm", "texture", None, 41, 1, "metric=ks; bins=8"
    )
    drift = Record("drift_percent", 1.25, "%", "fig8", "farneback", "lcm", None, "lcmsac", 1, 1, "align=none")
    return [
        fit,
        replace(fit, family="log-logistic", value=0.0521),
        replace(fit, family="gaussian", value=0.28),
        replace(fit, metric="coverage_90", value=0.9012, count=1234567),
        replace(fit, metric="coverage_90", family="gaussian", value=0.99),
        *(replace(fit, metric=f"coverage_{n}", value=n / 100 - 0.02) for n in (50, 68, 95, 99)),
        replace(fit, metric="ks_signed_max", value=None, protocol="metric=ks; reason=too few components"),
        drift,
        replace(drift, family="gaussian", estimator="ransac", value=4.5),
        replace(
            drift, metric="rpe_trans_median_m", value=0.00431, unit="m", protocol="align=none; scale=depth"
        ),
        replace(
            drift, metric="rpe_trans_median_m", value=0.0087, unit="m", family="gaussian", estimator="ransac"
        ),
        replace(drift, metric="frames_per_second", value=31.4, unit="1/s"),
        replace(drift, metric="curious <b>thing</b>", value=12345678.0, unit=""),
    ]


def write_run(
    run: Path, kinds=tuple(MAKERS), warnings=("14 % of <components> lie outside the model's range",)
):
    (run / "data").mkdir(parents=True)
    for kind in kinds:
        np.savez(run / "data" / f"{kind}--farneback-test.npz", **make(kind))
    write_records(run / "metrics.json", records())
    info = {
        "command": "flowlik reproduce --quick --out 'a & b'",
        "config": {"frames": 100, "path": "<worlds>"},
        "versions": {"flowlik": "0.1.0", "numpy": "2.4"},
        "seed": 1,
        "warnings": list(warnings),
    }
    write_json(run / "run.json", info)
    return run
