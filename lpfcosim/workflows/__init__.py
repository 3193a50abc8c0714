"""What a script calls and a command prints: campaigns simulated, fitted, forecast, designed.

Each workflow is a module with a function of the same name; `lpfcosim` hands on the functions and their
results.
"""

__all__ = [
    "calibration",
    "check",
    "deltag",
    "design",
    "forecast",
    "identify",
    "montecarlo",
    "progress",
    "result",
    "run",
    "simulate",
    "ttl",
]
