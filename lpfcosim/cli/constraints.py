"""Constraints of parameters of a fit, from options to the table ``[fit.parameters]``."""

from collections.abc import Callable, Sequence

from fit.errors import InputError, quote

Arguments = Sequence[str] | None


def read_constraints(
    fix: Arguments = None, tie: Arguments = None, prior: Arguments = None, bound: Arguments = None
) -> dict[str, dict[str, object]]:
    """Return the constraints by parameter that options state, as ``[fit.parameters]`` has them.

    Parameters
    ----------
    fix, tie, prior, bound : sequence of str, optional
        ``NAME`` or ``NAME=VALUE``, ``NAME=EXPR``, ``NAME=MEAN,SIGMA``, ``NAME=MIN:MAX``.

    Raises
    ------
    InputError
        If an option cannot be read, or options contradict each other.
    """
    table: dict[str, dict[str, object]] = {}
    arguments = {"--fix": fix, "--tie": tie, "--prior": prior, "--bound": bound}
    for option, argument in ((option, value) for option, some in arguments.items() for value in some or ()):
        form, read = _FORMS[option]
        name, equals, text = (part.strip() for part in argument.partition("="))
        fixed: dict[str, object] = {"vary": False} if option == "--fix" else {}
        try:
            entries = read(text) if equals else fixed
        except ValueError:
            entries = {}
        if not name or not entries:
            raise InputError(f"{option} {quote(argument)}: expected {form}")
        known = table.setdefault(name, {})
        if repeated := known.keys() & entries.keys():
            raise InputError(f"{option} {quote(argument)}: a second {min(repeated)} of {name}")
        known |= entries
    return table


def _bounds(text: str) -> dict[str, object]:
    low, high = text.split(":")
    return {name: float(x) for name, x in (("min", low), ("max", high)) if x.strip()}


_FORMS: dict[str, tuple[str, Callable[[str], dict[str, object]]]] = {
    "--fix": ("NAME or NAME=VALUE", lambda text: {"vary": False, "value": float(text)}),
    "--tie": ("NAME=EXPR", lambda text: {"expr": text}),
    "--prior": ("NAME=MEAN,SIGMA", lambda text: {"prior": [float(x) for x in text.split(",")]}),
    "--bound": ("NAME=MIN:MAX, one of the two may be empty", _bounds),
}
