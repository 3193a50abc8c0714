"""Colours of the figures by what they are for."""

from collections.abc import Mapping

#: On white; the page turns them into the variables of its light and dark scheme.
COLOURS: Mapping[str, str] = {
    "paper": "#ffffff",
    "ink": "#1c2530",
    "muted": "#5d6875",
    "grid": "#dfe3e8",
    "grey": "#8b95a1",
    "blue": "#2f74c0",
    "orange": "#d2541b",
    "green": "#1d8a6b",
    "violet": "#8457b8",
    "rose": "#b8336f",
    "cyan": "#0f87a5",
    "olive": "#7c7113",
}
