"""What to think of a calibration: its warnings, each once, and one line on whether it can be trusted."""

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass

from markupsafe import Markup

from fit.findings import KINDS, Finding, Severity
from fit.report.parameter_table import ParameterTable
from fit.results import Fit, Results
from fit.tables import LIMIT, combination_text, prose, symbol

NOT_CONVERGED = Finding("not_converged", "the iteration did not converge")


@dataclass(frozen=True)
class WarningItem:
    """A warning, once, with every fit it was raised in."""

    message: Markup
    combination: Markup | None
    scopes: tuple[str, ...]


@dataclass(frozen=True)
class WarningGroup:
    """All warnings of one code, and advice on them, which may be empty."""

    code: str
    messages: tuple[WarningItem, ...]
    advice: Markup


def fits(results: Results) -> Iterator[tuple[str, Fit]]:
    """Yield every fit of a calibration with its name in words."""
    if results.joint is not None:
        yield "joint fit", results.joint
    if results.ttl is not None:
        yield "tilt-to-length coupling", results.ttl
    kinds = {
        "experiment": results.experiments,
        "cross-talk of epoch": results.cross_talk,
        "inertial period": results.inertial,
    }
    for kind, members in kinds.items():
        for name, fit in members.items():
            yield f"{kind} {name}", fit


def fit_warnings(fit: Fit) -> list[Finding]:
    """Return the warnings of a fit; that it did not converge is one, whether it says so or not."""
    is_explained = any(w.code == NOT_CONVERGED.code for w in fit.warnings)
    return [*fit.warnings, *([] if fit.converged or is_explained else [NOT_CONVERGED])]


def biased(fit: Fit) -> set[str]:
    """Return the parameters whose bias exceeds their sigma, according to the warnings of a fit."""
    return {name for w in fit.warnings if w.kind.biased for name in w.parameters}


def warning_groups(results: Results) -> list[WarningGroup]:
    """Return the warnings by code, in the order in which the fits raise them."""
    scopes: dict[str, dict[tuple[Markup, Markup | None], list[str]]] = {}
    advice: dict[str, str] = {}
    for scope, fit in fits(results):
        for w in fit_warnings(fit):
            advice[w.code] = w.kind.advice
            several = w.combination is not None and len(w.combination) > 1
            combination = combination_text(w.combination) if w.combination and several else None
            message = prose(_sentence(w.message), w.parameters)
            scopes.setdefault(w.code, {}).setdefault((message, combination), []).append(scope)
    return [
        WarningGroup(
            code,
            tuple(
                WarningItem(message, combination, tuple(places))
                for (message, combination), places in scopes_of.items()
            ),
            _with_code(advice[code]),
        )
        for code, scopes_of in scopes.items()
    ]


def _sentence(message: str) -> str:
    """Return a message with a full stop and, unless it begins with a symbol, a capital."""
    subject = message.partition(" ")[0]
    return f"{message if '_' in subject else message[:1].upper() + message[1:]}".removesuffix(".") + "."


def _with_code(text: str) -> Markup:
    """Return a text with symbols, whose words between backquotes are code."""
    fragments = text.split("`")
    return Markup().join(
        Markup("<code>{}</code>").format(part) if i % 2 else prose(part) for i, part in enumerate(fragments)
    )


@dataclass(frozen=True)
class Verdict:
    """One line; `state` is ``good``, ``bad``, ``doubtful`` or, with nothing to be judged by, ``open``."""

    state: str
    text: Markup


def failures(fit: Fit) -> list[str]:
    """Return the codes of the warnings that spoil a fit."""
    return list(_reasons({"": fit}, Severity.FAILURE))


def verdict(
    results: Results, shown: Sequence[ParameterTable], identification: Results | None = None
) -> Verdict:
    """Say in one line whether the fits found the truth or, without one, agree with the flight.

    Good requires a truth and no objection: a fit that did not converge, a chi2 that is off or
    an estimate beyond the limit, in whatever fit, takes that away.

    Parameters
    ----------
    results : Results
        Judged by the joint fit or, without one, by the experiments; the other fits may raise doubts.
    shown : sequence of Table
        The table of the joint fit or those of the experiments.
    identification : Results, optional
        Of parameters of FMUs, from the same telemetry.
    """
    joint = results.joint or results.ttl
    kind = "joint" if results.joint else "tilt-to-length" if results.ttl else "single-experiment"
    has_truth = any(t.has_truth for t in shown)
    agreement, outliers = _agreement(shown, has_truth, kind=kind)
    single = {f"experiment {name}": fit for name, fit in results.experiments.items()}
    judged = {"": joint} if joint else single
    ids = {id(fit) for fit in judged.values()}
    other_fits = {name: fit for name, fit in fits(results) if id(fit) not in ids}
    identified = identification.joint if identification else None
    failed = _named(judged, Severity.FAILURE)
    failed += _named({"identification": identified}, Severity.FAILURE) if identified else []
    doubts = [*_named(judged, Severity.DOUBT), *_named(other_fits, Severity.FAILURE), *_outliers(other_fits)]
    head = Markup("" if joint else "No joint fit. ") + ("" if has_truth else "True values unknown. ")
    sentences = [*failed, agreement]
    if joint and joint.undetermined:
        sentences.append(Markup("Not determined by these data: {}.").format(symbols(joint.undetermined)))
    sentences += doubts
    # Another spacecraft need not agree with the flight; a simulation has to agree with its truth.
    bad = bool(failed) or (outliers and has_truth)
    state = "bad" if bad else "doubtful" if doubts else "good" if has_truth else "open"
    return Verdict(state, head + Markup(" ").join(sentences))


def symbols(names: Iterable[str]) -> Markup:
    """Return the symbols of parameters."""
    return Markup(", ").join(map(symbol, names))


def _agreement(shown: Sequence[ParameterTable], has_truth: bool, kind: str) -> tuple[Markup, bool]:
    """Say how the estimates compare, and whether one is beyond the limit."""
    rows = [row for t in shown for row in t.rows if row.estimate]
    pulls = [(row.symbol, row.pull) for row in rows if row.pull is not None]
    if not pulls:
        text = "Estimates are not compared with true values, since their uncertainties are not valid."
        return Markup(text if has_truth else "Nothing to compare the estimates with."), False
    reference = "true" if has_truth else "flight"
    subject = f"{kind} parameters" + f" with a {reference} value" * (len(pulls) < len(rows))
    outliers = [name for name, pull in pulls if abs(pull) > LIMIT]
    head = f"All {len(pulls)} {subject} lie within {LIMIT:g} σ of the {reference} values"
    if outliers:
        distance = f"further than {LIMIT:g} σ from the {reference} values"
        head = f"{len(outliers)} of {len(pulls)} {subject} lie {distance}: "
    worst, largest = max(pulls, key=lambda item: abs(item[1]))
    measure = "pull" if has_truth else "difference / σ"
    names = Markup(", ").join(outliers)
    return Markup("{}{}; largest |{}| {:.1f} ({}).").format(head, names, measure, abs(largest), worst), bool(
        outliers
    )


def _reasons(fits: Mapping[str, Fit], severity: Severity) -> dict[str, list[str]]:
    """Return by code which of some fits raise warnings of a severity, in the order of `KINDS`."""
    codes = {name: {w.code for w in fit_warnings(fit)} for name, fit in fits.items()}
    reasons = {
        code: [name for name in fits if code in codes[name]]
        for code, kind in KINDS.items()
        if kind.severity is severity
    }
    return {code: names for code, names in reasons.items() if names}


def _named(fits: Mapping[str, Fit], severity: Severity) -> list[str]:
    """Say which warnings of a severity were raised, and in which fits; the nameless one goes without."""
    return [
        f"{KINDS[code].headline}: {', '.join(names)}.".replace(": .", ".")
        for code, names in _reasons(fits, severity).items()
    ]


def _outliers(fits: Mapping[str, Fit]) -> list[Markup]:
    """Name the estimates beyond the limit of truth but those that are said to be biased."""
    outliers = [
        Markup("{} of {}").format(symbol(key), name)
        for name, fit in fits.items()
        for key, e in fit.parameters.items()
        if e.pull is not None and abs(e.pull) > LIMIT and key not in biased(fit)
    ]
    text = Markup("Further than {:g} σ from their true values: {}.").format(
        LIMIT, Markup(", ").join(outliers)
    )
    return [text] if outliers else []
