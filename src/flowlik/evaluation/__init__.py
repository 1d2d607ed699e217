"""Evaluation: goodness of fit, drift, and the evidence shown in reports."""
