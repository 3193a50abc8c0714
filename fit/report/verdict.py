"""The line above all others: whether the calibration can be trusted, as far as it can be told."""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass

from markupsafe import Markup

from fit.report import warnings as report_warnings
from fit.results import Fit, Results
from fit.tables import LIMIT, Table, symbol
from fit.warnings import KINDS, Severity


@dataclass(frozen=True)
class Verdict:
    """One line; `state` is ``good``, ``bad``, ``doubtful`` or, with nothing to be judged by, ``open``."""

    state: str
    text: Markup


def failing(fit: Fit) -> list[str]:
    """Return the codes of the warnings that spoil a fit."""
    return list(_told({"": fit}, Severity.FAILURE))


def verdict(results: Results, shown: Sequence[Table]) -> Verdict:
    """Say in one line whether the fits found the truth or, without one, agree with the flight.

    Good is only what has a truth and nothing against it: a fit that did not converge, a chi2 that is off or
    an estimate beyond the limit, in whatever fit, takes that away.

    Parameters
    ----------
    results : Results
        Judged by the joint fit or, without one, by the experiments; the other fits may raise doubts.
    shown : sequence of Table
        The table of the joint fit or those of the experiments.
    """
    joint = results.joint
    has_truth = any(t.has_truth for t in shown)
    agreement, beyond = _agreement(shown, has_truth, of="joint" if joint else "single-experiment")
    alone = {f"experiment {name}": fit for name, fit in results.experiments.items()}
    judged = {"": joint} if joint else alone
    everything = dict(report_warnings.fits(results))
    others = {name: fit for name, fit in everything.items() if all(fit is not one for one in judged.values())}
    failed = _named(judged, Severity.FAILURE)
    doubts = [*_named(judged, Severity.DOUBT), *_named(others, Severity.FAILURE), *_outliers(others)]
    head = Markup("" if joint else "No joint fit. ") + ("" if has_truth else "No truth in the telemetry. ")
    lost = joint.undetermined if joint else ()
    told = [*failed, agreement]
    if lost:
        told.append(Markup("Not determined by these data: {}.").format(_listed(map(symbol, lost))))
    told += doubts
    # Another spacecraft need not agree with the flight; a simulation has to agree with its truth.
    bad = bool(failed) or (beyond and has_truth)
    state = "bad" if bad else "doubtful" if doubts else "good" if has_truth else "open"
    return Verdict(state, head + Markup(" ").join(told))


def _listed(symbols: Iterable[str]) -> Markup:
    return Markup(", ").join(symbols)


def _agreement(shown: Sequence[Table], has_truth: bool, of: str) -> tuple[Markup, bool]:
    """Say how the estimates compare, and whether one is beyond the limit."""
    rows = [row for t in shown for row in t.rows if row.estimate]
    pulls = [(row.symbol, row.pull) for row in rows if row.pull is not None]
    if not pulls:
        return Markup("Nothing to compare the estimates with."), False
    what = f"{of} parameters{' that have one' * (len(pulls) < len(rows))}"
    target = f"{LIMIT:g} σ of {'truth' if has_truth else 'the flight values'}"
    beyond = [name for name, pull in pulls if abs(pull) > LIMIT]
    if beyond:
        head = Markup("{} of {} {} lie further than {}: {}").format(
            len(beyond), len(pulls), what, target, _listed(beyond)
        )
    else:
        head = Markup("All {} {} lie within {}").format(len(pulls), what, target)
    worst, largest = max(pulls, key=lambda item: abs(item[1]))
    measure = "pull" if has_truth else "difference / σ"
    return Markup("{}; largest |{}| {:.1f} ({}).").format(head, measure, abs(largest), worst), bool(beyond)


def _told(fits: Mapping[str, Fit], severity: Severity) -> dict[str, list[str]]:
    """Return by code which of some fits raise warnings of a severity, in the order of `KINDS`."""
    codes = {name: {w.code for w in report_warnings.raised(fit)} for name, fit in fits.items()}
    found = {
        code: [name for name in fits if code in codes[name]]
        for code, kind in KINDS.items()
        if kind.severity is severity
    }
    return {code: names for code, names in found.items() if names}


def _named(fits: Mapping[str, Fit], severity: Severity) -> list[str]:
    """Say which warnings of a severity were raised, and in which fits; the nameless one goes without."""
    return [
        f"{KINDS[code].words}: {', '.join(names)}.".replace(": .", ".")
        for code, names in _told(fits, severity).items()
    ]


def _outliers(fits: Mapping[str, Fit]) -> list[Markup]:
    """Name the estimates beyond the limit of truth but those that are said to be biased."""
    found = [
        Markup("{} of {}").format(symbol(key), name)
        for name, fit in fits.items()
        for key, e in fit.parameters.items()
        if e.pull is not None and abs(e.pull) > LIMIT and key not in report_warnings.biased(fit)
    ]
    return [Markup("Further than {:g} σ of truth: {}.").format(LIMIT, _listed(found))] if found else []
