"""What options say of parameters of a fit, as the table ``[fit.parameters]`` has it."""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass

from fit.errors import InputError, quote
from fit.settings import Settings, settings


@dataclass(frozen=True)
class Constraints:
    """What options say of a fit.

    Attributes
    ----------
    fix, tie, prior, bound : sequence of str
        ``NAME`` or ``NAME=VALUE``, ``NAME=EXPR``, ``NAME=MEAN,SIGMA``, ``NAME=MIN:MAX``.
    f_max : float, optional
        End of the fitted band [Hz].
    """

    fix: Sequence[str] = ()
    tie: Sequence[str] = ()
    prior: Sequence[str] = ()
    bound: Sequence[str] = ()
    f_max: float | None = None

    def on(self, chosen: Settings) -> Settings:
        """Return settings with what the options say in the place of what they say of the same parameters.

        Raises
        ------
        InputError
            If an option cannot be read, or options contradict each other.
        """
        said: dict[str, dict[str, object]] = {}
        for option, form, given in self._each():
            name, equals, text = given.partition("=")
            if not name.strip() or not (equals or option == "--fix"):
                raise InputError(f"{option} {quote(given)}: expected {form}")
            found = _READ[option](text, f"{option} {quote(given)}", form) if equals else {"vary": False}
            known = said.setdefault(name.strip(), {})
            if twice := known.keys() & found.keys():
                raise InputError(f"{option} {quote(given)}: a second {min(twice)} of {name.strip()}")
            known |= found
        table = chosen.record()
        of_file = {name: p.model_dump(exclude_defaults=True) for name, p in chosen.parameters.items()}
        table["parameters"] = {**of_file, **said}
        if self.f_max is not None:
            table["f_max"] = self.f_max
        return settings(table, "options")

    def _each(self) -> Iterable[tuple[str, str, str]]:
        for option, form, given in (
            ("--fix", "NAME or NAME=VALUE", self.fix),
            ("--tie", "NAME=EXPR", self.tie),
            ("--prior", "NAME=MEAN,SIGMA", self.prior),
            ("--bound", "NAME=MIN:MAX, one of the two may be empty", self.bound),
        ):
            yield from ((option, form, each) for each in given)


def _number(text: str, where: str, form: str) -> float:
    try:
        return float(text)
    except ValueError:
        raise InputError(f"{where}: {quote(text)} is not a number, expected {form}") from None


def _fixed(text: str, where: str, form: str) -> dict[str, object]:
    return {"vary": False, "value": _number(text, where, form)}


def _tied(text: str, where: str, form: str) -> dict[str, object]:
    if not text.strip():
        raise InputError(f"{where}: no expression, expected {form}")
    return {"expr": text.strip()}


def _prior(text: str, where: str, form: str) -> dict[str, object]:
    parts = text.split(",")
    if len(parts) != 2:
        raise InputError(f"{where}: expected {form}")
    return {"prior": [_number(part, where, form) for part in parts]}


def _bounds(text: str, where: str, form: str) -> dict[str, object]:
    parts = text.split(":")
    if len(parts) != 2 or not any(part.strip() for part in parts):
        raise InputError(f"{where}: expected {form}")
    pairs = zip(("min", "max"), parts, strict=True)
    return {name: _number(part, where, form) for name, part in pairs if part.strip()}


_READ = {"--fix": _fixed, "--tie": _tied, "--prior": _prior, "--bound": _bounds}
