"""What a spacecraft model is: Modelica models joined by name, and what a run gives them."""

from __future__ import annotations

import hashlib
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass
from functools import cached_property

from lpfcosim.modelica import build, numpy_models
from lpfcosim.network import Component, in_order
from lpfcosim.signals import TARGETS, Source
from lpfcosim.spacecraft import Run

#: Values of parameters by name; None leaves a parameter at its default.
Parameters = Mapping[str, float | None]


@dataclass(frozen=True)
class SpacecraftModel:
    """Models of one configuration of the spacecraft, and what a run gives them; SI.

    Wiring, recorded channels, units and defaults follow from the models: an input is fed by the output of
    the same name of another model, or by a signal of that name; outputs that the telemetry contract knows
    are recorded.

    Attributes
    ----------
    name : str
        In words that follow "runs".
    config_type : type
        Of `Run.spacecraft`, by which a run chooses its model.
    models : tuple of str
        Models of the Modelica package, one FMU each, in any order.
    shared_parameters : callable
        From a run to parameters of all models that have one of that name.
    model_parameters : callable
        From a run to further parameters of single models.
    sources : callable
        Streams of noise.
    attitude_rates : callable
        Set points that grow steadily, by name, and their rates [rad/s].
    affected_truths : mapping of str to mapping of str to tuple of str
        By model, input or parameter: the names under /truth that hold only of a model that takes it.
    attributes : callable
        Root attributes of a telemetry file beyond the x axis.
    truth : callable
        True values beyond the x axis, under their names in /truth.
    sample_cost, experiment_cost : float
        What `lpfcosim run` takes on a processor of 2024 [s]: a sample of 10 Hz with noise and file, the fit
        and the figures of an experiment with injections.
    """

    name: str
    config_type: type
    models: tuple[str, ...]
    shared_parameters: Callable[[Run], Parameters]
    model_parameters: Callable[[Run], Mapping[str, Parameters]]
    sources: Callable[[Run], tuple[Source, ...]]
    attitude_rates: Callable[[Run], Mapping[str, float]]
    affected_truths: Mapping[str, Mapping[str, tuple[str, ...]]]
    attributes: Callable[[Run], dict[str, float]]
    truth: Callable[[Run], dict[str, float]]
    sample_cost: float
    experiment_cost: float

    @cached_property
    def units(self) -> dict[str, str]:
        """Unit of each input, output and parameter, as Modelica spells it; a name means one thing."""
        units: dict[str, str] = {}
        for module in map(numpy_models.load, self.models):
            described = {name: unit for name, (_, unit) in (module.PARAMETERS | module.INPUTS).items()}
            units |= described | module.OUTPUTS
        return units

    @property
    def equations_digest(self) -> str:
        """SHA-256 of the sources of the models and of their translator."""
        packages = sorted({build.package_of(model) for model in self.models})
        digests = [numpy_models.digest(package) for package in packages]
        return digests[0] if len(digests) == 1 else hashlib.sha256("".join(digests).encode()).hexdigest()

    @cached_property
    def record(self) -> dict[str, str]:
        """Telemetry channel to its source, named as in `Component.inputs`."""
        from fit.telemetry import CHANNELS

        sources = {name: name for name in self._signals if name.startswith("guidance_")} | self._outputs
        return {channel: sources[channel] for channel in CHANNELS if channel in sources}

    @cached_property
    def _outputs(self) -> dict[str, str]:
        """Output variable to ``Model.output``."""
        return {name: f"{model}.{name}" for model in self.models for name in numpy_models.load(model).OUTPUTS}

    @cached_property
    def _signals(self) -> tuple[str, ...]:
        """Inputs that no model feeds."""
        inputs = dict.fromkeys(name for model in self.models for name in numpy_models.load(model).INPUTS)
        return tuple(name for name in inputs if name not in self._outputs)

    def stimuli(self, run: Run) -> tuple[str, ...]:
        """Return the signals from outside that drive a run, injections first."""
        noise = (into for source in self.sources(run) for into, _ in source.shares)
        return tuple(dict.fromkeys((*TARGETS, *self.attitude_rates(run), *noise)))

    def components(self, run: Run) -> tuple[Component, ...]:
        """Return the models of a run in the order of their steps, without inputs that nothing feeds."""
        stimuli = set(self.stimuli(run))
        ignored = {r.model: r.unused for r in run.replacements}
        inputs = {
            model: {
                name: self._outputs.get(name, name)
                for name in numpy_models.load(model).INPUTS
                if name in self._outputs or name in stimuli
            }
            for model in self.models
        }
        used = {source for sources in inputs.values() for source in sources.values()}
        used |= set(self.record.values())
        components = []
        for model in self.models:
            module = numpy_models.load(model)
            outputs = tuple(name for name in module.OUTPUTS if f"{model}.{name}" in used)
            taken = {name: s for name, s in inputs[model].items() if name not in ignored.get(model, ())}
            moves = bool(module.STATES) and set(outputs) <= set(module.STATE_OUTPUTS)
            components.append(Component(model, taken, outputs, moves))
        return in_order(components)

    def parameters(self, run: Run) -> dict[str, dict[str, float]]:
        """Return the parameters that a run gives each model, by name."""
        shared, of_models = self.shared_parameters(run), self.model_parameters(run)
        parameters: dict[str, dict[str, float]] = {}
        for model in self.models:
            values = {**shared, **of_models.get(model, {})}
            parameters[model] = {
                name: value
                for name in numpy_models.load(model).PARAMETERS
                if (value := values.get(name)) is not None
            }
        return parameters

    def unknown_truths(self, run: Run, ignored: Mapping[str, Iterable[str]]) -> set[str]:
        """Return names under /truth that say nothing if models, by name, ignore inputs or parameters."""
        names = {
            truth
            for model, ignored_names in ignored.items()
            for name in ignored_names
            for truth in self.affected_truths.get(model, {}).get(name, ())
        }
        return names | ({f"delta_ifo_{k}" for k in run.truth.delta_ifo} if "delta_ifo" in names else set())


MODELS: dict[type, SpacecraftModel] = {}


def model_of(run: Run) -> SpacecraftModel:
    """Return the spacecraft model of a run: that of the type of `Run.spacecraft`."""
    return MODELS[type(run.spacecraft)]


def register(*models: SpacecraftModel) -> None:
    """Add models to those that runs can choose."""
    MODELS.update({model.config_type: model for model in models})


def fmu_names() -> tuple[str, ...]:
    """Return the names of the FMUs of all spacecraft models."""
    return tuple(dict.fromkeys(name for spacecraft in MODELS.values() for name in spacecraft.models))
