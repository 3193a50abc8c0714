"""Is the closed loop stable? Said before anything is simulated."""

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from lpfcosim.errors import InputError
from lpfcosim.linear.closed_loop import ClosedLoop
from lpfcosim.spacecraft import Run


def poles(run: Run) -> NDArray[np.complex128]:
    """Poles z of the sampled closed loop, largest magnitude first, as long as no command is at its limit."""
    return ClosedLoop(run).linearize().observable().poles()


def check(*runs: Run) -> None:
    """Refuse runs whose loop is not asymptotically stable.

    Raises
    ------
    InputError
        Gives the pole furthest out: z, s = ln z / h, its frequency and how fast it grows.
    """
    # what a loop is has nothing to do with when it runs, what drives it and with which noise
    checked: set[str] = set()
    for run in runs:
        anonymous_run = replace(run, name="", experiment="", kind="sysid", t0="", n_samples=1, seed=0)
        loop = repr(replace(anonymous_run, dc=0.0, noise={}, injections=(), events=None))
        if loop not in checked:
            checked.add(loop)
            _check(run)


def _check(run: Run) -> None:
    try:
        with np.errstate(all="ignore"):
            z = poles(run)[0]
    except (ArithmeticError, ValueError, np.linalg.LinAlgError):  # what overflow and its NaNs lead to
        z = np.complex128(np.nan)
    if abs(z) < 1:
        return
    if not np.isfinite(z):
        raise InputError(f"{run.name}: the closed loop has no finite poles, its parameters are implausible")
    s = np.log(z) / run.h
    growth = f"grows by e in {1 / s.real:.3g} s" if s.real > 0 else "never decays"
    raise InputError(
        f"{run.name}: the closed loop is unstable, its pole z = {z:.6g} (s = {s:.4g} 1/s, "
        f"{abs(s.imag) / (2 * np.pi):.3g} Hz) {growth}"
    )
