"""Leave one out: the joint fit without each experiment, and whether that moves it more than it should."""

from typing import TYPE_CHECKING

from fit.errors import FitError, InputError
from fit.results import Results, check_results, sound_joint

if TYPE_CHECKING:
    import pandas

MIN_SHIFT_STDERR = 1e-6  # of sigma: the standard deviation of a shift below which it is rounding


def leave_one_out(results: Results) -> "pandas.DataFrame":
    """Return the estimates of the joint fit without each experiment in turn.

    The compressed runs are fitted again by least squares, which takes milliseconds.

    Parameters
    ----------
    results : Results
        Of `fit.calibrate`, with a sound joint fit of two experiments or more.

    Returns
    -------
    DataFrame
        Indexed by the experiment left out (``without``) and by ``parameter``: ``value`` and ``sigma`` without
        it, and ``shift``, the difference from the joint fit in units of its standard deviation. That is less
        than either sigma, since both fits share the other experiments. Parameters that these do not determine
        have no row.

    Raises
    ------
    InputError
        If there is no such joint fit.
    """
    import pandas as pd  # slow to import

    check_results(results, "leave_one_out")
    joint = sound_joint(results)
    if (solved := joint.solved) is None:
        raise InputError("leave_one_out: results from a file, expected those of fit.calibrate")
    estimates = solved.result.params
    rows: dict[tuple[str, str], tuple[float, float, float]] = {}
    for run in results.experiments:
        try:
            reduced = solved.exclude(run)
        except (InputError, FitError):  # it takes no part, is the only one, or the others have no solution
            continue
        sigmas = dict(zip(estimates, solved.shift_sigma(reduced, run).tolist(), strict=True))
        for name in joint:
            p, is_weak = reduced.params[name], estimates[name].user_data is None
            if p.stderr and not (is_weak and p.user_data):
                shift = p.value - estimates[name].value
                rows[run, name] = (p.value, p.stderr, shift / max(sigmas[name], MIN_SHIFT_STDERR * p.stderr))
    index = pd.MultiIndex.from_tuples([*rows], names=["without", "parameter"]) if rows else None
    return pd.DataFrame([*rows.values()], index=index, columns=["value", "sigma", "shift"])
