"""The units the telemetry contract asks of its channels, and the spellings of one unit."""

import re
from collections import Counter
from collections.abc import Mapping

#: The channels a calibration needs, and their units.
REQUIRED: Mapping[str, str] = {"o_1": "m", "o_12": "m", "f_x_1": "m s-2", "f_x_2": "m s-2"}

_OPTIONAL = (
    (re.compile(r"guidance_o_(1|12)|grs_[xyz]_[12]"), "m"),
    (re.compile(r"o_(phi|eta)_(1|12)|grs_(theta|eta|phi)_[12]|ast_(theta|eta|phi)"), "rad"),
    (re.compile(r"F_[xyz]_([12]|sc)"), "N"),
    (re.compile(r"N_(theta|eta|phi)_[12]|N_[xyz]_sc"), "N m"),
)
_SYMBOL = re.compile(r"(/?)(?:([A-Za-z]+)\^?([+-]?\d+)?|(\S))\s*")


def expected_unit(channel: str) -> str | None:
    """Return the unit the contract gives a channel, None for a channel it does not know."""
    if channel in REQUIRED:
        return REQUIRED[channel]
    return next((unit for pattern, unit in _OPTIONAL if pattern.fullmatch(channel)), None)


def same_unit(a: str, b: str) -> bool:
    """Tell whether two texts spell one unit; prefixes are not converted.

    Examples
    --------
    >>> same_unit("m s-2", "m/s^2"), same_unit("nm", "m")
    (True, False)
    """
    return _powers(a) == _powers(b)


def _powers(unit: str) -> dict[str, int] | str:
    """Return the power of every symbol, or the text itself where it is no product of powers."""
    if len(unit) > 80:
        return unit
    text = re.sub(r"\s*/\s*", "/", unit.replace("**", "^")).replace("·", " ").replace("*", " ").strip()
    powers: Counter[str] = Counter()
    for slash, symbol, power, other in _SYMBOL.findall(text):
        if other:
            return unit
        powers[symbol] += int(power or 1) * (-1 if slash else 1)
    return {symbol: power for symbol, power in powers.items() if power}
