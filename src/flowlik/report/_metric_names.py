"""What metrics are called in tables, and what they mean in a few words."""

from __future__ import annotations

METRICS: dict[str, tuple[str, str]] = {
    "drift_percent": ("Drift", "final position error, share of the path's length"),
    "t_err_percent": ("Translation drift", "over 100 m to 800 m, as KITTI measures it"),
    "r_err_deg_per_100m": ("Rotation drift", "over 100 m to 800 m, as KITTI measures it"),
    "ate_rmse_m": ("Position error", "root mean square along the path"),
    "rpe_trans_median_m": ("Median translation error", "of one frame's motion"),
    "rpe_rot_median_deg": ("Median rotation error", "of one frame's motion"),
    "ks_median": (
        "Misfit (K‑S median)",
        "largest gap between measured and modelled distribution; 0 is perfect",
    ),
    "ks_max": ("Worst misfit (K‑S)", "at the texture level that fits least"),
    "coverage_90": ("Coverage of 90 %", "share of errors inside the model's own 90 % interval"),
    "coverage_ellipse_90": (
        "Coverage of 90 % ellipses",
        "share of vectors whose error lies inside the ellipse of the covariance for filters",
    ),
    "nll": ("Negative log-likelihood", "lower is better"),
    "ks_signed_median": ("Misfit of signed errors (K‑S median)", "also notices a bias"),
    "ks_floor_median": (
        "Distance between two samples (K‑S median)",
        "of the same kind of images: no model can be expected to do better",
    ),
    "ks_floor_max": ("Distance between two samples, worst (K‑S)", "at the texture level that differs most"),
    "coverage_90_worst_level": (
        "Coverage of 90 %, worst texture",
        "at the counted texture level where it is farthest from 90 %",
    ),
    "pit_deviation": (
        "Worst twentieth of the PIT",
        "relative deviation of a bin of the model's own distribution from its due share",
    ),
    "pit_ks": ("Misfit of the PIT (K‑S)", "of signed errors of all textures together"),
    "ause_mean": ("AUSE, mean", "area between removal by predicted spread and by true error; 0 is perfect"),
    "ause_median": ("AUSE, median", "the same for the median error"),
    "ause_rmse": ("AUSE, root mean square", "the same for the capped root mean square error"),
    "ause_relative": ("AUSE over chance", "of the mean error; 0 is a perfect ranking, 1 is none"),
    "rank_correlation": ("Rank correlation", "Spearman's, of predicted spread and error; 1 is perfect"),
    "negative_share": ("Share that falls short", "of signed errors; half without bias"),
    "negative_share_low_texture": ("Share that falls short, low texture", "texture below 56"),
    "signed_median": ("Median signed error", "negative: the flow falls short"),
    "signed_median_low_texture": ("Median signed error, low texture", "texture below 56"),
    "signed_mean": ("Mean signed error", "capped at 100 px"),
    "signed_mean_low_texture": ("Mean signed error, low texture", "texture below 56, capped at 100 px"),
    "ks_textures_alike": ("Misfit, textures alike (K‑S)", "where t₂/t₁ exceeds 0.7"),
    "ks_textures_apart": ("Misfit, textures apart (K‑S)", "where t₂/t₁ is below 0.7"),
    "nll_gain_of_pooling": (
        "Gain of pooling",
        "in log-likelihood, if components of like texture shared one distribution",
    ),
    "half_width_e1_median_px": (
        "Half-width, best direction",
        "of the interval along the strongest texture: the median",
    ),
    "half_width_e2_median_px": (
        "Half-width, worst direction",
        "of the interval along the weakest texture: the median",
    ),
    "within_half_px_fraction": (
        "Known to half a pixel",
        "share of components whose interval reaches no further than half a pixel",
    ),
    "flow_factor_fraction": ("Frames with flow", "share of frames whose flow was fused"),
    "attitude_sigma_median_deg": ("Stated attitude", "standard deviation of all axes together, median"),
    "velocity_sigma_median_mps": ("Stated velocity", "standard deviation of all axes together, median"),
    "position_sigma_median_m": ("Stated position", "standard deviation of all axes together, median"),
    "attitude_rms_deg": ("Attitude error", "root mean square"),
    "position_rms_m": ("Position error", "root mean square, in the frame of GPS"),
    "nis_mean": ("NIS", "squared innovations of GPS over their covariance; 3 if all is honest"),
    "imu_time_offset_s": ("IMU stamped late by", "what the images' rotations tell; warned of beyond 5 ms"),
    "imu_time_offset_low_s": ("IMU late, at least", "lower end of the 95 % interval"),
    "imu_time_offset_high_s": ("IMU late, at most", "upper end of the 95 % interval"),
    "gps_alarms": ("Alarms of GPS", "whether the monitor found a drift"),
    **{
        f"information_share_{sensor}_{part}": (
            f"Share of {name}: {part}",
            f"of the information, what would be gone without {name}; median",
        )
        for sensor, name in (("flow", "flow"), ("gps", "GPS"))
        for part in ("attitude", "velocity", "position")
    },
    "unsolved_fraction": ("Unsolved frames", "share of frames without a motion"),
    "outside_fraction": (
        "Share outside the calibrated range",
        "of error components; above 10 % is a warning",
    ),
    "t_err_offset_removed_percent": (
        "Translation drift, constant direction offset removed",
        "a diagnosis of the calibration, not a result",
    ),
    "rpe_trans_ratio_to_ransac": ("Translation error over RANSAC's", "median of a frame; below 1 is better"),
}
"""By metric: its name, and its meaning."""
