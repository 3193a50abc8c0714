"""What can go wrong, told apart by what the user can do about it."""


class LpfcosimError(Exception):
    """Base of every error this package raises on purpose."""


class InputError(LpfcosimError):
    """The input is wrong; the message names the file, the place in it and what was expected (exit 2)."""


class RunError(LpfcosimError):
    """The input is sound but the work failed (exit 1)."""
