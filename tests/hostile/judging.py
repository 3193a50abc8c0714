"""What becomes of a fault, seen from outside: the results, their errors, and what is said of them."""

import re
from collections.abc import Iterable
from dataclasses import dataclass
from functools import cache

from fit.errors import CalibrationError, InputError
from fit.pipeline import calibrate
from fit.results import Fit
from tests.hostile.catalogue import Fault
from tests.hostile.spoiling import clean
from tests.oracles.thirteen import PLANS, TRUTH

FAR = 5.0  # sigma
UNNAMED = (
    "alone puts",
    "does not fit either",
    "changes within the run",
    "do not follow the equation",
    "jumps by",
)
LONG = "D3"
NARROW = 0.85  # of the sigma without the fault, upon which no copy may improve
RESTS = "high_leverage"  # said of a clean campaign too


@dataclass(frozen=True)
class Judged:
    """What becomes of a fault.

    Attributes
    ----------
    outcome : str
        "refused" (exit status 2), "failed" (1), "no sigma" or "sound".
    pull : float
        Largest error of the joint fit in its sigmas, 0 without one.
    checked : float
        The same over the parameters that are not reported to depend on a run of the fault.
    width : float
        Smallest sigma of the joint fit over that of the campaign without the fault; 1 if there are no copies.
    left_out : tuple of str
        Experiments that are not in the joint fit.
    minority : bool
        Whether these are more than half of all.
    names_run, names_cause : bool
        Whether what is said of the joint fit names an experiment of the fault, and words for its cause.
    said : tuple of str
        Errors and warnings of the joint fit.
    """

    outcome: str
    pull: float
    checked: float
    width: float
    left_out: tuple[str, ...]
    minority: bool
    names_run: bool
    names_cause: bool
    said: tuple[str, ...]

    def telling(self, fault: Fault) -> str:
        """Return the first of what is said that names the fault, or else the first of all."""
        named = [words for words in self.said if _names([words], fault)]
        return next(iter(named + list(self.said)), "")

    def verdict(self, fault: Fault) -> str:
        """Judge: "ok", or what is wrong with it, the worst first."""
        if self.outcome == "sound" and self.pull > FAR:
            told = fault.blind and (self.checked <= FAR or "depends on" not in fault.blind)
            return "ok" if told else "silent"
        if self.outcome == "sound" and self.minority:
            return "minority"
        if self.outcome == "sound" and self.width < NARROW:
            return "too sure"
        if fault.harmless and self.outcome != "sound":
            return "cries wolf"
        if self.outcome in ("refused", "failed") and len(fault.run.split()) in (1, 2):
            return "costs all"
        innocent = {name.split("x")[0] for name in self.left_out} - set(fault.run.split())
        if innocent and (fault.run or fault.harmless):
            return "costs others"
        if fault.harmless and self.left_out:
            return "costs a run"
        if not fault.harmless and not fault.blind and (self.outcome != "sound" or self.left_out):
            if fault.run and not self.names_run:
                return "wrong run"
            if fault.cause and not self.names_cause:
                unknown = any(words in sentence for words in UNNAMED for sentence in self.said)
                return "no cause" if unknown else "wrong cause"
        return "ok"


def judge(fault: Fault, names: Iterable[str] | None = None) -> Judged:
    """Put a fault into a campaign and see what the fit makes of it.

    Without `names` of experiments it is the whole campaign, save that the tone run of 65 h, half of all
    samples, takes part in its own faults only.
    """
    names = tuple(names or (name for name in PLANS if name != LONG or LONG in fault.run))
    runs = fault.make(clean(names))
    try:
        results = calibrate(list(runs.values()))
    except InputError as error:
        return _without_result("refused", str(error), fault)
    except CalibrationError as error:
        return _without_result("failed", str(error), fault)
    joint = results.joint
    if joint is None or not joint.parameters:
        said = joint.warnings[0].message if joint and joint.warnings else "no joint fit"
        return _without_result("failed", said, fault)
    taking_part = set(results.provenance.joint_runs or ())
    said = tuple(w.message for w in (*joint.unsound, *joint.warnings) if w.code != RESTS or fault.blind)
    resting = {
        name
        for w in joint.warnings
        if w.code == RESTS and _names([w.message], fault)
        for name in w.parameters
    }
    experiments = [r for r in runs.values() if r.kind == "sysid"]
    left_out = tuple(r.experiment for r in experiments if r.run not in taking_part)
    return Judged(
        outcome="no sigma" if joint.unsound else "sound",
        pull=_pull(joint, TRUTH),
        checked=_pull(joint, {n: value for n, value in TRUTH.items() if n not in resting}),
        width=1.0 if runs.keys() == clean(names).keys() else _width(joint, _sigmas(names)),
        left_out=left_out,
        minority=2 * len(left_out) > len(experiments),
        names_run=_names(said, fault),
        names_cause=any(re.search(fault.cause, words) for words in said),
        said=tuple(dict.fromkeys(said)),
    )


@cache
def _sigmas(names: tuple[str, ...]) -> dict[str, float]:
    """Return the sigmas of the joint fit of the campaign without a fault."""
    joint = calibrate(list(clean(names).values())).joint
    assert joint is not None
    return {name: estimate.sigma for name, estimate in joint.parameters.items()}


def _width(joint: Fit, clean: dict[str, float]) -> float:
    return min(e.sigma / clean[name] for name, e in joint.parameters.items() if name in clean)


def _without_result(outcome: str, message: str, fault: Fault) -> Judged:
    named, cause = _names([message], fault), bool(re.search(fault.cause, message))
    return Judged(outcome, 0.0, 0.0, 1.0, (), False, named, cause, (message,))


def _names(said: Iterable[str], fault: Fault) -> bool:
    runs = "|".join(fault.run.split())
    return bool(runs) and any(re.search(rf"\b({runs})(x\d)?\b", words) for words in said)


def _pull(fit: Fit, truth: dict[str, float]) -> float:
    """Return the largest error in sigmas."""
    errors = (abs(e.value - truth[name]) / e.sigma for name, e in fit.parameters.items() if name in truth)
    return max(errors, default=0.0)
