"""The command ``mcmc``: the posterior of an earlier calibration, sampled."""

from pathlib import Path
from typing import Annotated

import typer

from fit import figures, mcmc, refit
from fit.errors import InputError
from fit.posterior import Posterior
from lpfcosim.console import Console


def mcmc_command(
    directory: Annotated[Path, typer.Argument(metavar="DIR", help="Folder of an earlier run or fit.")],
    steps: Annotated[int, typer.Option("--steps", min=1, help="Steps at most, by this call.")] = 20000,
    seed: Annotated[int, typer.Option("--seed", min=0, help="Of a new chain.")] = 1,
    quiet: Annotated[bool, typer.Option("--quiet", help="Print nothing but errors.")] = False,
) -> None:
    """Sample the posterior of the joint fit in DIR by Markov chain Monte Carlo; continues what is there.

    Leaves mcmc.h5 (the chain), mcmc.json and figures/corner.svg in DIR once the chain has converged: 50
    autocorrelation times of every parameter. Until then the exit status is 1, and the same command continues.
    """
    from fit import figures_mcmc

    console = Console(quiet=quiet)
    with console.stage("reading"):
        results, telemetries = refit.load(directory)
    with console.stage("fit"):
        outcome = refit.refit(results, telemetries, directory / "results.json")
    try:
        posterior = Posterior(outcome)
    except InputError as error:
        raise InputError(f"{directory / 'results.json'}: {error}") from None
    with console.counted("steps", steps) as progress:
        chain = mcmc.sample(posterior, directory / "mcmc.h5", steps=steps, seed=seed, progress=progress)
    joint = results.joint.parameters if results.joint else {}
    truths = {name: e.truth for name, e in joint.items() if e.truth is not None}
    document = mcmc.summary(chain, outcome, truths)
    mcmc.write(document, directory / "mcmc.json")
    with console.stage("figure"):
        text = figures.svg(
            figures_mcmc.corner_plot, chain.theta.reshape(-1, chain.theta.shape[2]), outcome, truths
        )
        (directory / "figures").mkdir(exist_ok=True)
        (directory / "figures" / "corner.svg").write_text(text, encoding="utf-8")
    console.say(
        f"{chain.steps} steps of {chain.z.shape[1]} walkers, autocorrelation time up to {max(chain.tau):.0f} "
        f"steps; means within {document['largest_shift_in_sigma']:.2g} sigma of least squares"
    )
    console.say(f"chain: {directory / 'mcmc.h5'}, summary: {directory / 'mcmc.json'}")
