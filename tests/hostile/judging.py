"""What becomes of a fault, seen from outside: the results, their errors, and what is said of them."""

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
LONG = "D3"
NARROW = 0.85  # of the sigma without the fault, upon which no copy may improve
CHECKED_BY_NOTHING = "high_leverage"  # said of a clean campaign too


@dataclass(frozen=True)
class Judged:
    """What becomes of a fault.

    Attributes
    ----------
    outcome : str
        "refused" (exit status 2), "failed" (1), "not sound" or "sound".
    pull : float
        Largest error of the joint fit in its sigmas, but of parameters that cannot show it; 0 without one.
    width : float
        Smallest sigma of the joint fit over that of the campaign without the fault; 1 if there are no copies.
    left_out : tuple of str
        Experiments that are not in the joint fit.
    messages : tuple of str
        Errors and warnings of the joint fit.
    """

    outcome: str
    pull: float = 0.0
    width: float = 1.0
    left_out: tuple[str, ...] = ()
    messages: tuple[str, ...] = ()

    def verdict(self, fault: Fault) -> str:
        """Judge: "ok", or what is wrong with it, the worst first."""
        names = set(fault.run.split())
        innocent = {name.removesuffix("x") for name in self.left_out} - names
        if self.outcome == "sound":
            if self.pull > FAR:
                return "silent"
            if 2 * len(self.left_out) > len(PLANS):
                return "minority"
            if self.width < NARROW:
                return "too sure"
        elif fault.harmless:
            return "false alarm"
        elif self.outcome != "not sound" and len(names) in (1, 2):
            return "costs all"
        if innocent and (names or fault.harmless):
            return "costs others"
        return "costs a run" if fault.harmless and self.left_out else "ok"


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
        return Judged("refused", messages=(str(error),))
    except CalibrationError as error:
        return Judged("failed", messages=(str(error),))
    joint = results.joint
    if joint is None or not joint.parameters:
        return Judged("failed", messages=tuple(w.message for w in joint.warnings) if joint else ())
    taking_part = set(results.provenance.joint_runs or ())
    warnings = [w for w in (*joint.unsound, *joint.warnings) if w.code != CHECKED_BY_NOTHING]
    return Judged(
        outcome="not sound" if joint.unsound else "sound",
        pull=_pull(joint, fault.blind),
        width=1.0 if runs.keys() == clean(names).keys() else _width(joint, _sigmas(names)),
        left_out=tuple(r.experiment for r in runs.values() if r.kind == "sysid" and r.run not in taking_part),
        messages=tuple(dict.fromkeys(w.message for w in warnings)),
    )


@cache
def _sigmas(names: tuple[str, ...]) -> dict[str, float]:
    """Return the sigmas of the joint fit of the campaign without a fault."""
    joint = calibrate(list(clean(names).values())).joint
    assert joint is not None
    return {name: estimate.sigma for name, estimate in joint.parameters.items()}


def _width(joint: Fit, clean: dict[str, float]) -> float:
    return min(e.sigma / clean[name] for name, e in joint.parameters.items() if name in clean)


def _pull(fit: Fit, blind: Iterable[str]) -> float:
    """Return the largest error in sigmas."""
    estimates = {name: e for name, e in fit.parameters.items() if name in TRUTH and name not in blind}
    return max((abs(e.value - TRUTH[name]) / e.sigma for name, e in estimates.items()), default=0.0)
