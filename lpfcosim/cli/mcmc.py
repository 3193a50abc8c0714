"""The command ``mcmc``: the posterior of an earlier calibration, sampled."""

from collections.abc import Sequence
from pathlib import Path

from fit.crosstalk import attenuation, refit
from fit.files import atomic
from fit.report import page as fit_report
from fit.results import Results
from fit.sampling import Posterior
from fit.sampling import emcee_sampling as chains
from fit.telemetry import Telemetry
from lpfcosim.cli.console import Console
from lpfcosim.execution import results_folder


def mcmc(directory: Path, console: Console, *, steps: int, seed: int) -> None:
    """Sample the posterior of the joint fit in a folder; continue what is there."""
    with console.stage("reading"):
        results, telemetries = refit.load(directory)
    with results_folder.lock(directory):
        _sample(directory, results, telemetries, console, steps=steps, seed=seed)


def _sample(
    directory: Path,
    results: Results,
    telemetries: Sequence[Telemetry],
    console: Console,
    *,
    steps: int,
    seed: int,
) -> None:
    for warning in results.joint.unsound if results.joint else ():
        console.warn(f"{directory / 'results.json'}: joint: {warning.message}")
    joint = results.joint.parameters if results.joint else {}
    corrected = attenuation.iv_parameters(results.joint)
    corrected_estimates = {name: e for name, e in joint.items() if name in corrected}
    if corrected_estimates:
        names = ", ".join(corrected_estimates)
        console.note(
            f"sampled by least squares, then corrected and widened as by instrumental variables: {names}"
        )
    with console.stage("fit"):
        outcome = refit.refit(results, telemetries, directory / "results.json")
    posterior = Posterior(outcome)
    with console.counted("autocorrelation times", chains.MIN_LENGTH) as progress:
        path, identity = directory / "mcmc.h5", chains.digest(results)
        chain = chains.sample(posterior, path, identity, steps=steps, seed=seed, progress=progress)
    chain, outcome = chains.apply_iv_correction(chain, outcome, corrected_estimates)
    truths = {name: e.truth for name, e in joint.items() if e.truth is not None}
    document = chains.summary(chain, outcome, truths)
    text = atomic.write_json(directory / "mcmc.json", document)
    with console.stage("figure"):
        from fit.plotting import studies, write  # takes its time

        (directory / "figures").mkdir(exist_ok=True)
        theta = chain.theta.reshape(-1, chain.theta.shape[2])
        write(directory / "figures", "corner", studies.corner_plot, theta, outcome, truths)
    console.print_line(
        f"{chain.steps} steps of {chain.z.shape[1]} walkers, autocorrelation time up to {max(chain.tau):.0f} "
        f"steps; means within {document['largest_shift_in_sigma']:.2g} sigma of the joint fit"
    )
    console.print_json(text)
    with console.stage("report"):
        page = fit_report.write_report(directory, results, telemetries)
    console.print_line(f"chain: {directory / 'mcmc.h5'}, summary: {directory / 'mcmc.json'}, report: {page}")
