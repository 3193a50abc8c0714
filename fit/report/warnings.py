"""The warnings of all fits, each once, with what to do about it."""

import re
from collections.abc import Iterator
from dataclasses import dataclass

from markupsafe import Markup, escape

from fit.results import Fit, Results
from fit.tables import parameters as tables
from fit.warnings import FitWarning

NOT_CONVERGED = FitWarning("not_converged", (), "the iteration did not converge")


@dataclass(frozen=True)
class Notice:
    """A warning, once, with every fit it was raised in."""

    message: str
    combination: Markup | None
    scopes: tuple[str, ...]


@dataclass(frozen=True)
class Matter:
    """All warnings of one code, and what to do about them; empty where nobody knows."""

    code: str
    notices: tuple[Notice, ...]
    advice: Markup


def fits(results: Results) -> Iterator[tuple[str, Fit]]:
    """Yield every fit of a calibration with its name in words."""
    if results.joint is not None:
        yield "joint fit", results.joint
    for kind, found in (
        ("experiment", results.experiments),
        ("cross-talk of epoch", results.cross_talk),
        ("inertial period", results.inertial),
    ):
        for name, fit in found.items():
            yield f"{kind} {name}", fit


def raised(fit: Fit) -> list[FitWarning]:
    """Return the warnings of a fit; that it did not converge is one, whether it says so or not."""
    told = any(w.code == NOT_CONVERGED.code for w in fit.warnings)
    return [*fit.warnings, *([] if fit.converged or told else [NOT_CONVERGED])]


def biased(fit: Fit) -> set[str]:
    """Return the parameters that a fit says differ from the truth by more than their sigma tells."""
    return {name for w in fit.warnings if w.kind.biased for name in w.parameters}


def matters(results: Results) -> list[Matter]:
    """Return what there is to warn of, by code, in the order in which the fits raise it."""
    scopes: dict[str, dict[tuple[str, Markup | None], list[str]]] = {}
    advice: dict[str, str] = {}
    for scope, fit in fits(results):
        for w in raised(fit):
            advice[w.code] = w.kind.advice
            several = w.combination is not None and len(w.combination) > 1
            combination = tables.combination_text(w.combination) if w.combination and several else None
            scopes.setdefault(w.code, {}).setdefault((w.message, combination), []).append(scope)
    return [
        Matter(
            code,
            tuple(
                Notice(_sentence(message), combination, tuple(where))
                for (message, combination), where in of.items()
            ),
            _with_code(advice[code]),
        )
        for code, of in scopes.items()
    ]


def _sentence(message: str) -> str:
    """Return a message with a capital, unless a symbol stands there, and a full stop."""
    first = message.partition(" ")[0]
    return f"{message if '_' in first else message[:1].upper() + message[1:]}".removesuffix(".") + "."


def _with_code(text: str) -> Markup:
    """Return a text whose words between backquotes are code."""
    return Markup(re.sub(r"`([^`]*)`", r"<code>\1</code>", str(escape(text))))
