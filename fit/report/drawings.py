"""The figures of one experiment on the page, and what to see in them."""

from collections.abc import Iterable, Mapping
from pathlib import Path

from fit.figures import Drawing, drawing
from fit.figures import delta_g as figures_delta_g
from fit.figures import runs as figures
from fit.telemetry import Telemetry
from fit.warnings import FitWarning, masked


def drawings(
    folder: Path,
    stem: str,
    slug: str,
    runs: tuple[Telemetry, Telemetry | None],
    parameters: Mapping[str, float],
    warnings: Iterable[FitWarning],
) -> tuple[Drawing, ...]:
    """Return responses, spectra, breakdown and residual, their files written to ``folder``.

    Parameters
    ----------
    folder : Path
        An existing one.
    stem, slug : str
        What makes names of files and ids unique (letters and digits), and what makes them readable.
    runs : tuple of Telemetry
        The run of the experiment, and its noise run or None.
    parameters : mapping
        Those of `fit.model.dynamics.residual`.
    warnings : iterable of FitWarning
        Of the fit; they tell what was masked.
    """
    run, noise = runs
    terms = figures_delta_g.split(run, parameters)
    beside = figures_delta_g.split(noise, parameters) if noise else None
    level = (
        "The residual should lie on the noise at every frequency; a peak left at an injected one is "
        "something the model lacks."
        if noise
        else "There is no noise run to compare with; a peak left at an injected frequency is something the "
        "model lacks."
    )
    return (
        drawing(
            folder,
            (f"{stem}r", f"{slug}-responses"),
            "Guidance injections and read-outs of both loops against time",
            "Injections and responses. A loop makes its read-out follow the guidance while it has gain; the "
            "scatter of o₁ is the jitter of the spacecraft. Every stroke spans the extremes of its samples.",
            figures.responses,
            run,
        ),
        drawing(
            folder,
            (f"{stem}s", f"{slug}-spectra"),
            "Amplitude spectral densities of signal, residual and noise run",
            f"Signal, residual and noise; the fit ends at 0.1 Hz. {level} Bands: ±1 σ of noise, from the "
            "number of ordinates averaged.",
            figures_delta_g.acceleration,
            terms,
            beside,
        ),
        drawing(
            folder,
            (f"{stem}b", f"{slug}-breakdown"),
            "Amplitude spectral densities of the terms that add up to the differential acceleration",
            "Breakdown of Δg: the terms of eq. deltagjointfit as fitted, and their sum, the residual. Where "
            "two of them lie far above it, they cancel.",
            figures_delta_g.breakdown,
            terms,
        ),
        drawing(
            folder,
            (f"{stem}t", f"{slug}-residual"),
            "Residual differential acceleration against time",
            f"Residual Δg less its mean, averaged with Hann windows of {figures_delta_g.SLOW:g} s; grey, the "
            f"extremes of it averaged over {figures_delta_g.FAST:g} s. What is missing or masked is marked.",
            figures_delta_g.residual,
            run,
            parameters,
            masked(warnings, run.run),
        ),
    )
