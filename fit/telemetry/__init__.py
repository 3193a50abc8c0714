"""Telemetry: the contract of its files, their reader and writer, and archives that a map turns into them.

A run is a `Telemetry`; its channels are read when they are asked for. Files from elsewhere are tried by
another process first (`guard`).
"""
