"""What a spacecraft model is: Modelica models joined by name, and what a run gives them."""

from __future__ import annotations

import hashlib
import re
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any

from fit.units import contract_spelling
from lpfcosim.modelica import build, numpy_models
from lpfcosim.network import Component, in_order
from lpfcosim.signals import Source
from lpfcosim.spacecraft import Authority, Run

#: Equation of motion of LISA Pathfinder, `fit.model.dynamics`.
DELTA_G = "delta_g"
#: Values of parameters by name; None leaves a parameter at its default.
Parameters = Mapping[str, float | None]


def common_parameters(run: Run) -> dict[str, float | None]:
    """Return sample time, mass of a test mass and authorities of a run, SI."""
    authority = {name: getattr(run.authority, name) for name in ("F_max_1", "F_max_2", "N_max_1", "N_max_2")}
    return {"h": run.h, "m_tm": run.m_tm, **authority}


def _nothing(_: Run) -> dict[str, Any]:
    return {}


@dataclass(frozen=True)
class SpacecraftModel:
    """Models of one configuration of the spacecraft, and what a run gives them; SI.

    Wiring, recorded channels, units and defaults follow from the models: an input is fed by the output of
    the same name of another model, or by a signal of that name; outputs that the telemetry contract knows
    are recorded. Of `Run.parameters` a run has what the models have and `shared_parameters` and
    `model_parameters` do not give.

    Attributes
    ----------
    key : type or str
        By which a run chooses its model: the type of `Run.spacecraft`, or its value, a name.
    name : str
        In words that follow "runs".
    models : tuple of str
        Names of FMUs, made from models of Modelica packages, in any order.
    sources : callable
        From a run to its streams of noise.
    targets : tuple of str
        Signals that injections may go into.
    read_outs : tuple of str
        Read-outs that end at `READ_OUT_RANGE`.
    commands : tuple of str
        Commands whose limits are checked before a run; a fit masks where they are reached.
    noise : mapping of str to str
        Levels of noise beyond the fields of `Noise`, each with a signal whose unit it has, per root hertz.
    channels : tuple of str
        Outputs and signals recorded beyond those of the telemetry contract and the guidance; not of a plant,
        whose outputs a co-simulation has after their step.
    shared_parameters : callable
        From a run to parameters of all models that have one of that name.
    model_parameters : callable
        From a run to further parameters of single models.
    attitude_rates : callable
        Set points that grow steadily, by name, and their rates [rad/s].
    affected_truths : mapping of str to mapping of str to tuple of str
        By model, input or parameter: the names under /truth that hold only of a model that takes it, where it
        is not the name itself.
    attributes : callable
        Root attributes of a telemetry file beyond the x axis.
    equation : str
        Equation of motion that `fit` has for its telemetry; ``""`` if none, so that it can only be simulated.
    truth : callable, optional
        True values under their names in /truth; by default the parameters that `Run.parameters` may have.
    """

    key: type | str
    name: str
    models: tuple[str, ...]
    sources: Callable[[Run], tuple[Source, ...]]
    targets: tuple[str, ...]
    read_outs: tuple[str, ...]
    commands: tuple[str, ...] = ()
    noise: Mapping[str, str] = field(default_factory=dict)
    channels: tuple[str, ...] = ()
    shared_parameters: Callable[[Run], Parameters] = common_parameters
    model_parameters: Callable[[Run], Mapping[str, Parameters]] = _nothing
    attitude_rates: Callable[[Run], Mapping[str, float]] = _nothing
    affected_truths: Mapping[str, Mapping[str, tuple[str, ...]]] = field(default_factory=dict)
    attributes: Callable[[Run], Mapping[str, str | float]] = _nothing
    equation: str = ""
    truth: Callable[[Run], dict[str, float]] | None = None

    @cached_property
    def reference_run(self) -> Run:
        """A run of this spacecraft with the authority of experiment A."""
        authority = Authority("A", 0.0, 2200e-12, 10.4e-12, 10.4e-12)
        spacecraft = self.key if isinstance(self.key, str) else self.key()
        return Run("place", "place", "noise", 1, authority, spacecraft=spacecraft)

    @cached_property
    def units(self) -> dict[str, str]:
        """Unit of each input, output and parameter, as Modelica spells it; a name means one thing."""
        units: dict[str, str] = {}
        for module in map(numpy_models.load, self.models):
            described = {name: unit for name, (_, unit) in (module.PARAMETERS | module.INPUTS).items()}
            units |= described | module.OUTPUTS
        return units

    def unit(self, name: str) -> str:
        """Return the unit of an input, output or parameter, as the telemetry contract spells it."""
        return contract_spelling(self.units[name])

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

        guidance = {name: name for name in self.targets if name.startswith("guidance_")}
        sources = guidance | self._outputs
        names = dict.fromkeys((*(name for name in CHANNELS if name in sources), *guidance, *self.channels))
        return {name: sources.get(name, name) for name in names}

    @cached_property
    def labels(self) -> dict[str, tuple[str, str]]:
        """Unit and description of each recorded channel, of the telemetry contract or of the models."""
        from fit.telemetry import CHANNELS

        modules = [numpy_models.load(model) for model in self.models]
        text = {name: words for module in modules for name, words in module.DESCRIPTIONS.items()}
        text |= {name: module.DESCRIPTIONS[name] for module in modules for name in module.OUTPUTS}
        return {name: CHANNELS.get(name) or (self.unit(name), text[name]) for name in self.record}

    @cached_property
    def truths(self) -> dict[str, float]:
        """Defaults of the parameters that `Run.parameters` may have: those of models without control laws."""
        return {
            name: value
            for module, names in self._free_parameters().items()
            for name, (value, _) in numpy_models.load(module).PARAMETERS.items()
            if name in names and name.isidentifier() and not numpy_models.load(module).ERRORS
        }

    @cached_property
    def controllers(self) -> dict[str, tuple[str, ...]]:
        """Parameters that `Run.controllers` may have, by model with control laws."""
        return {
            model: tuple(name for name in names if name not in self.truths)
            for model, names in self._free_parameters().items()
            if numpy_models.load(model).ERRORS
        }

    def _free_parameters(self) -> dict[str, tuple[str, ...]]:
        """Return the parameters of each model that a run of this spacecraft does not give."""
        run = self.reference_run
        shared, of_models = self.shared_parameters(run), self.model_parameters(run)
        return {
            model: tuple(
                name
                for name in numpy_models.load(model).PARAMETERS
                if name not in shared and name not in of_models.get(model, {})
            )
            for model in self.models
        }

    @cached_property
    def noise_units(self) -> dict[str, str]:
        """Units of the levels of `noise`, as campaigns spell them."""
        return {level: f"{self.unit(signal)} Hz^-0.5".strip() for level, signal in self.noise.items()}

    @cached_property
    def disturbances(self) -> tuple[str, ...]:
        """Stray accelerations of the test masses, into which pulses may go."""
        return tuple(name for name in self._signals if re.fullmatch(r"g(_[xyz])?_[12]", name))

    def true_values(self, run: Run) -> dict[str, float]:
        """Return the true values of a run, under their names in /truth."""
        return {**(self.truth(run) if self.truth else self.truths), **run.parameters}

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
        return tuple(dict.fromkeys((*self.targets, *self.attitude_rates(run), *noise)))

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
            values = {
                **shared, **of_models.get(model, {}), **run.parameters, **run.controllers.get(model, {})
            }  # fmt: skip
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
            for truth in self.affected_truths.get(model, {}).get(name, (name,) if name in self.truths else ())
        }
        return names | ({f"delta_ifo_{k}" for k in run.truth.delta_ifo} if "delta_ifo" in names else set())


MODELS: dict[type | str, SpacecraftModel] = {}


def registered() -> dict[type | str, SpacecraftModel]:
    """Return the spacecraft models by key; keys of LISA Pathfinder are types, those of others names."""
    return dict(MODELS)


def model_of(run: Run) -> SpacecraftModel:
    """Return the spacecraft model of a run: that of the value or of the type of `Run.spacecraft`."""
    return MODELS[run.spacecraft if isinstance(run.spacecraft, str) else type(run.spacecraft)]


def register(*models: SpacecraftModel) -> None:
    """Add models to those that runs can choose."""
    MODELS.update({model.key: model for model in models})


def fmu_names() -> tuple[str, ...]:
    """Return the names of the FMUs of all spacecraft models."""
    return tuple(dict.fromkeys(name for spacecraft in MODELS.values() for name in spacecraft.models))
