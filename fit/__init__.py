"""Calibration of drag-free spacecraft from telemetry: the estimators, usable on any contract file."""
