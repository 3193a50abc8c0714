"""What can go wrong, told apart by what the user can do about it."""


class CalibrationError(Exception):
    """Base of every error this package raises on purpose."""


class InputError(CalibrationError):
    """The input is wrong; the message names the file, the place in it and what was expected (exit 2)."""


class FitError(CalibrationError):
    """The input is sound but no trustworthy estimate came out of it (exit 1)."""
