"""What a script calls and a command prints: campaigns simulated, fitted, forecast, designed.

Each workflow is a module with a function of the same name; `lpfcosim` hands on the functions and their
results.
"""
