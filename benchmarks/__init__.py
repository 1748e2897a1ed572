"""Measurements of the package: accuracy, stability, speed, scale, seeds, intervals."""
