"""The kinds of figure a run can have: what each needs, how it is drawn and how it is read."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field

from matplotlib.figure import Figure

from flowlik.report._draw_calibration import (
    draw_coverage,
    draw_distributions,
    draw_error_over_texture,
    draw_goodness,
    draw_table,
)
from flowlik.report._draw_drives import draw_intrinsics, draw_outliers, draw_segment_errors
from flowlik.report._draw_evidence import (
    draw_bias,
    draw_eigenbasis,
    draw_levels,
    draw_pit,
    draw_sparsification,
)
from flowlik.report._draw_flow import draw_sequence
from flowlik.report._draw_fusion import draw_biases, draw_contributions, draw_innovations
from flowlik.report._draw_gauntlet import draw_gauntlet
from flowlik.report._draw_motion import draw_frame_errors, draw_trajectories
from flowlik.report._draw_uncertainty import draw_uncertainty
from flowlik.report._draw_without_truth import draw_without_truth
from flowlik.report._style import Data


@dataclass(frozen=True)
class FigureKind:
    """One kind of figure.

    Parameters
    ----------
    draw : callable
        Arrays to matplotlib figure.
    title : str
        What it shows, in a few words.
    caption : str
        How to read it; ``{name}`` stands for a scalar among the arrays.
    required : mapping of str to str
        Arrays it needs and their shapes: letters are lengths shared between arrays, ``X+1`` is one more.
    optional : mapping of str to str
        Arrays it draws when they are there.
    """

    draw: Callable[[Data], Figure]
    title: str
    caption: str
    required: Mapping[str, str]
    optional: Mapping[str, str] = field(default_factory=dict)


FIGURES: dict[str, FigureKind] = {
    "uncertainty": FigureKind(
        draw_uncertainty,
        "Where the flow can be trusted",
        "Each cross is the flow's error at one pixel: its two bars lie along the image's own "
        "directions of strongest (e₁) and weakest (e₂) texture and reach as far as {confidence:.0%} "
        "of errors, magnified. A small cross means the flow is known both ways. One long bar marks an"
        " edge: the flow is known across it, but not along it. Bars that end in arrow heads are "
        "longer than drawn. Below, the same half-widths for every pixel, and the flow itself.",
        {"image": "H W", "flow": "H W 2", "half_width": "H W 2", "angle": "H W", "confidence": ""},
    ),
    "flow-sequence": FigureKind(
        draw_sequence,
        "Flow sequence",
        "Top: images. Middle: the true flow. Bottom: the flow as estimated. Hue is the direction of "
        "motion and saturation its length, as on the wheel. Where bottom and middle differ in colour,"
        " the flow is wrong.",
        {"images": "n H W", "true_flow": "n H W 2", "flow": "n H W 2"},
    ),
    "error-over-texture": FigureKind(
        draw_error_over_texture,
        "Flow error over texture",
        "How often an error of a given size (vertical) occurs at a given texture (horizontal); darker"
        " is more often, and both axes are logarithmic. Lines that fall to the right say that more "
        "texture means smaller errors, which is what the model learns. Where the model's own bound is"
        " drawn, it should lie on the dashed line.",
        {"texture_edges": "X+1", "error_edges": "Z+1", "counts": "X Z"},
        {"bound_texture": "B", "bound_90": "B"},
    ),
    "table": FigureKind(
        draw_table,
        "The learned look-up table",
        "The parameters of the error distribution over the coordinate of its schedule (in the paper the "
        "texture; else the size of error that several signs together predict): fitted at the knots "
        "(dots), interpolated between them. Where grey shading is drawn, it shows how many components "
        "were seen at each coordinate; knots with none beneath them rest on their neighbours. Where a "
        "band is drawn, 95 % of tables fitted to other choices of the same frames lie within it.",
        {"knots": "M", "values": "M P", "names": "P", "units": "P"},
        {"edges": "T+1", "counts": "T", "low": "M P", "high": "M P", "coordinate": ""},
    ),
    "without-truth": FigureKind(
        draw_without_truth,
        "Errors predicted and found, before and after",
        "On pairs of images that the model was not learned from, errors are taken against the images' own "
        "motions. Left: the size that 68 % of errors stay below, as predicted and as found; on the dashed "
        "line the model is honest, below it errors are smaller than it says. Right: the share of errors "
        "within the intervals said to hold 50 % and 90 %, for fifths of the vectors from small to large "
        "predicted errors and from little to much texture.",
        {
            "names": "N",
            "predicted": "N B",
            "found": "N B",
            "levels": "L",
            "by_size": "N L F",
            "by_texture": "N L F",
        },
    ),
    "distributions": FigureKind(
        draw_distributions,
        "Measured and fitted error distributions",
        "One row per range of texture [intensity²/px²], from little to much. Left: the middle 80 % of the "
        "errors on a linear scale. Right: all but a few on a logarithmic scale, which shows the "
        "tails. The fitted line should follow the measured errors in both. Negative errors mean the "
        "flow falls short.",
        {"level_edges": "L 2", "z": "L B", "empirical": "L B", "fitted": "L B"},
    ),
    "goodness": FigureKind(
        draw_goodness,
        "Goodness of fit over texture",
        "The Kolmogorov–Smirnov distance is the largest gap between the measured and the modelled "
        "cumulative distribution of |z|: 0 is a perfect fit, lower is better. Pale, hollow levels "
        "hold too few components to count; the medians are over the others. Where grey shading is "
        "drawn, it is the distance between the errors of two different sets of images of the same kind: "
        "no model can be expected to do better. The strip below shows how many components there are.",
        {"texture": "X", "families": "F", "ks": "F X", "counted": "X", "counts": "X"},
        {"floor": "X"},
    ),
    "coverage": FigureKind(
        draw_coverage,
        "Coverage of the intervals",
        "Of the intervals said to hold, for example, 90 % of errors, how many really do? On the "
        "dashed line the model is honest; below it, too bold; above it, too cautious.",
        {"nominal": "C", "names": "F", "observed": "F C"},
    ),
    "levels": FigureKind(
        draw_levels,
        "Coverage and log score over texture",
        "Top: of the intervals said to hold {confidence:.0%} of errors, the share that does, at each "
        "texture. Within the grey band it is off by five percentage points at most; below it the model is "
        "too bold there, above too cautious. Bottom: the negative log-likelihood, lower is better; only "
        "models of the same flow and images can be compared. Hollow levels hold too few components to "
        "count.",
        {
            "texture": "X",
            "names": "F",
            "coverage": "F X",
            "nll": "F X",
            "counted": "F X",
            "confidence": "",
        },
    ),
    "pit": FigureKind(
        draw_pit,
        "Where errors fall in their own distribution",
        "Each error is placed by the share of errors that the model said would be smaller (more negative): "
        "0.5 is the middle, 0 and 1 are the far tails. For an honest model every twentieth is as full as "
        "any other, and the line lies at 1. A hump in the middle: errors are smaller than said. A dip: "
        "larger. High ends: more outliers than said. More on the left than on the right: the flow falls "
        "short more often than it overshoots. What is far too full leaves the figure at the top.",
        {"edges": "B+1", "names": "F", "density": "F B"},
    ),
    "sparsification": FigureKind(
        draw_sparsification,
        "Does the model know which errors are large?",
        "Components are removed, those of largest predicted spread first, and the error of what stays is "
        "divided by the error of all. A curve that falls fast means that the model knows where the flow is "
        "bad; the grey line removes by the true error, which nothing can beat, since even a true "
        "distribution does not tell which draw is large; removal at random would stay at 1. AUSE is the "
        "area between a curve and the grey line.",
        {
            "removed": "G",
            "names": "F",
            "statistics": "K",
            "curves": "F K G",
            "oracle": "F K G",
            "ause": "F K",
        },
    ),
    "bias": FigureKind(
        draw_bias,
        "Does the flow fall short?",
        "Errors along the measured flow, at each texture. Left: the share that is negative, where the "
        "measured flow is shorter than the true one; without bias it is half. Right: median and mean of "
        "the signed error beside the typical size of an error (grey); the scale is linear near 0 and "
        "logarithmic beyond. The mean follows a few gross errors, which make the measured flow too long more "
        "often than too short; the median does not. Pale dots hold less than a thousandth of the components.",
        {
            "texture": "X",
            "negative": "X",
            "median": "X",
            "mean": "X",
            "median_magnitude": "X",
            "counts": "X",
        },
    ),
    "eigenbasis": FigureKind(
        draw_eigenbasis,
        "Where both directions have the same texture",
        "At the right end the two eigenvalues are alike, and the directions e₁ and e₂ of the error are "
        "arbitrary, though the model takes them as certain. If that cost much, its misfit would rise to "
        "the right. Left: what pooling changes in the negative log-likelihood, below 0 is a gain; pooling "
        "gives both components the same distribution as t₂/t₁ goes to 1. Right: the Kolmogorov–Smirnov "
        "distance, 0 is a perfect fit. Shaded: how many components there are.",
        {"ratio_edges": "R+1", "counts": "R", "names": "N", "nll": "N R", "ks": "N R"},
    ),
    "trajectories": FigureKind(
        draw_trajectories,
        "Trajectories",
        "The path seen in the plane of its largest extent. Where the truth is known, beside it what is "
        "between each estimate and the truth, in the same plane, and how far that is as time goes on. "
        "Errors add up along the way; a lower line drifts less. Where no scale is known, every motion "
        "counts as one step. "
        "Crosses are frames that the images did not tell: their motion is predicted.",
        {"names": "E", "positions": "E N 3", "timestamps": "N", "unit": ""},
        {"truth": "N 3", "unsolved": "E N"},
    ),
    "innovations": FigureKind(
        draw_innovations,
        "Does GPS agree with the rest?",
        "Each dot is a fix minus where IMU, flow and the fixes before it said that the antenna would be, "
        "along each axis; 95 % should lie in the grey band. NIS is its square over its covariance, all axes "
        "together: 3 on average if all is honest (line), and one in twenty above the dashed line. Below, "
        "how much more likely a slow drift of GPS is than none; beyond the red line there is an alarm. Red: "
        "the alarm, and when the drift began.",
        {"timestamps": "G", "innovations": "G 3", "sigma": "G 3", "nis": "G"},
        {"statistic": "G", "threshold": "", "alarm": "3"},
    ),
    "biases": FigureKind(
        draw_biases,
        "Biases of the IMU",
        "What is known of each axis' bias at every moment; the band holds 95 %. It narrows as flow and GPS "
        "tell what the IMU alone cannot.",
        {"timestamps": "N", "values": "N 6", "sigma": "N 6"},
    ),
    "contributions": FigureKind(
        draw_contributions,
        "What each sensor contributed",
        "Stated standard deviations, all axes together, with everything, and as they would be without flow "
        "or without GPS from the first state on. The wider the gap, the more that sensor tells; the IMU is "
        "in all.",
        {
            "timestamps": "N",
            "names": "V",
            "attitude": "V N",
            "velocity": "V N",
            "position": "V N",
        },
    ),
    "frame-errors": FigureKind(
        draw_frame_errors,
        "Error of each frame's motion",
        "Left: the error of every single frame-to-frame motion, on a logarithmic scale. Right: the "
        "share of frames whose error is smaller than the value below; a curve further left is better,"
        " and it crosses the dashed line at its median.",
        {"names": "E", "translation": "E N", "rotation": "E N", "timestamps": "N"},
    ),
    "segment-errors": FigureKind(
        draw_segment_errors,
        "Error over length and speed",
        "KITTI's error: how far off the end of a piece of the path is, in per cent of its length, and by how "
        "much it is turned. Left: over the length of the piece; a constant wrong direction costs the same at "
        "every length, noise averages out. Right: over the speed driven.",
        {
            "names": "E",
            "lengths": "L",
            "speeds": "S",
            "translation_by_length": "E L",
            "rotation_by_length": "E L",
            "translation_by_speed": "E S",
            "rotation_by_speed": "E S",
        },
    ),
    "intrinsics": FigureKind(
        draw_intrinsics,
        "The camera, as its own images tell it",
        "What self-calibration believes of each parameter after every frame, from images alone; the band "
        "holds 95 % of its uncertainty. It starts as wide as the prior and narrows where the road turns; "
        "straight on, images hardly tell the principal point from the direction of travel.",
        {"names": "P", "timestamps": "N", "values": "N P", "sigma": "N P"},
    ),
    "outliers": FigureKind(
        draw_outliers,
        "What moves by itself",
        "Flow vectors that agree with the camera's own motion (blue) and that do not (red): moving "
        "vehicles, and what flow got wrong. A vehicle that moves along the camera's own epipolar lines, as "
        "one straight ahead does, cannot be told from the road without depth.",
        {"image": "H W", "pixels": "V 2", "flow": "V 2", "inlier": "V"},
    ),
    "gauntlet": FigureKind(
        draw_gauntlet,
        "Surely wrong, situation by situation",
        "How often a motion that was claimed is grossly wrong: beyond twice the radius of its own 99.9 % "
        "region. A row is a situation, a column a flow with known depth or with one camera, a panel an "
        "estimator; numbers are per cent. White: at most 0.2 %. Grey: nothing was claimed; that is no fault.",
        {"situations": "S", "columns": "C", "estimators": "E", "rates": "E S C"},
    ),
}
