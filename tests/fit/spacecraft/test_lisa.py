"""The observable of a LISA spacecraft: against Newton's equations of a closed loop."""

from dataclasses import replace

import numpy as np
import pytest

from fit.errors import InputError
from fit.spacecraft import lisa
from fit.spacecraft.lisa import COLUMNS, LISA, PARAMETERS, ROTATION, Component
from fit.spectra import windowing
from tests.oracles import lisa_loop
from tests.oracles.lisa_loop import World

MISALIGNED = {
    "o_per_y_1": 2e-3, "o_per_y_2": -1e-3, "grs_y_per_x_1": 0.02, "grs_y_per_x_2": -0.03,
    "opening": 5e-4, "d_x": 4e-3, "d_y": 0.494, "dws_gain": 1.03,
}  # fmt: skip
ALL = (*PARAMETERS, *ROTATION, "lambda_x_2", "C_x_2")
INJECTED = ("r_o_1", "r_o_2", "r_y_1", "r_y_2", "r_phi")


def delays(world):
    return tuple(world.truth[f"C_y_{j}"] / world.truth[f"lambda_y_{j}"] for j in (1, 2))


def columns_of(outputs, f, world, early=0.0):
    """`COLUMNS` of read-outs and commands at f, some time [s] before they act, shape (n, 19)."""
    s, tau = 2j * np.pi * f, dict(zip((1, 2), np.subtract(delays(world), early), strict=True))
    channel = dict(zip(lisa_loop.OUTPUTS, outputs.T, strict=True))
    columns = np.zeros((f.size, len(COLUMNS)), complex)
    for name in ("o_1", "o_2", "grs_y_1", "grs_y_2"):
        columns[:, COLUMNS.index(name)] = channel[name]
        columns[:, COLUMNS.index(f"dd{name}")] = s**2 * channel[name]
    for name in ("F_y_1", "F_y_2", "F_x_2"):
        force = channel[name] / lisa_loop.M_TM * lisa_loop.hold(s, tau[int(name[-1])])
        columns[:, COLUMNS.index(name)] = force
        columns[:, COLUMNS.index(f"d{name}")] = s * force
    for column, name in (("ddphi", "dws_phi"), ("ddX_1", "X_1"), ("ddX_2", "X_2")):
        columns[:, COLUMNS.index(column)] = s**2 * channel[name]
    return columns


@pytest.mark.parametrize("component", ["D_x", "D_y", "I_1", "I_2"])
@pytest.mark.parametrize("source", INJECTED)
@pytest.mark.parametrize("geometry", [{}, MISALIGNED])
@pytest.mark.parametrize("fall_back", [False, True])
def test_the_true_parameters_leave_nothing_of_an_injection(component, source, geometry, fall_back):
    world = World(geometry=geometry, fall_back=fall_back)
    world.truth["C_x_2"] = world.truth["lambda_x_2"] * delays(world)[1]  # one delay for both commands
    f = np.geomspace(1e-4, 0.1, 200)
    outputs, _ = lisa_loop.closed_loop(world, f)
    columns = columns_of(outputs[:, :, lisa_loop.SOURCES.index(source)], f, world)
    equation = Component(component, ALL)
    value = {"dws_gain": 1.0, "d_y": 0.5, **world.truth, **geometry}
    theta = equation.parameters_of(value)
    terms = columns @ equation.basis * equation.coefficients(theta, delays(world))
    # the oracle gets X_j as a difference of accelerations that are larger than what is left of them
    largest = np.abs(columns if component[0] == "I" else terms).max()
    assert np.all(np.abs(terms.sum(axis=1)) < 1e-12 * largest)


@pytest.mark.parametrize("component", ["D_x", "D_y", "I_2"])
def test_what_is_left_of_a_delay_is_linear(component):
    world, f, early = World(fall_back=True), np.geomspace(1e-4, 0.1, 50), 1e-3
    world.truth["C_x_2"] = world.truth["lambda_x_2"] * delays(world)[1]
    outputs, _ = lisa_loop.closed_loop(world, f)
    equation = Component(component, ALL)
    theta = equation.parameters_of({"dws_gain": 1.0, "d_y": 0.5, **world.truth})
    tau = tuple(np.subtract(delays(world), early))
    for source in INJECTED:
        columns = columns_of(outputs[:, :, lisa_loop.SOURCES.index(source)], f, world, early)
        terms = columns @ equation.basis * equation.coefficients(theta, tau)
        forces = [COLUMNS.index(name) for name in ("F_y_1", "F_y_2", "F_x_2")]
        largest = np.abs(columns[:, forces]).max()
        assert np.abs(terms.sum(axis=1)).max() < 1e-6 * largest  # (omega early)^2 / 2 is 2e-7


@pytest.mark.parametrize("component", ["D_x", "D_y", "I_1", "I_2"])
@pytest.mark.parametrize("tau", [(0.1, 0.2), (0.15, 0.17)])
def test_gradient_is_that_of_the_coefficients(component, tau):
    equation, rng = Component(component, ALL), np.random.default_rng(1)
    theta = rng.normal(size=len(ALL)) + 3
    step = 1e-6 * np.eye(theta.size)
    slopes = [
        (equation.coefficients(theta + d, tau) - equation.coefficients(theta - d, tau)) / 2e-6 for d in step
    ]
    np.testing.assert_allclose(equation.gradient(theta, tau), np.transpose(slopes), atol=1e-6)


def test_columns_are_right_in_the_whole_band():
    world = World()
    run = lisa.LISA.channels(lisa_loop.run(world, lisa_loop.sequence(1e-6)))
    assert run.parameters == PARAMETERS
    columns = np.concatenate(list(LISA.column_groups(run, delays(world))), axis=1)
    spectra = windowing.transform(columns, np.ones(len(columns), dtype=bool), run.fs)
    for equation in LISA.equations(run):
        theta = equation.parameters_of(world.truth)
        terms = spectra.columns @ equation.basis * equation.coefficients(theta, delays(world))
        assert np.abs(terms.sum(axis=1)).max() < 1e-10 * np.abs(terms).max()


def test_noise_of_both_components_at_a_millihertz():
    # Acceptance numbers of the study: 8.1e-14 and 1.4e-13 m s^-2 Hz^-1/2, uncorrelated.
    world, f = World(), np.array([1e-3])
    outputs, _ = lisa_loop.closed_loop(world, f)
    level = lisa_loop.levels(world, f)
    noise = np.stack([level[name] * outputs[:, :, i] for i, name in enumerate(lisa_loop.NOISES)], axis=-1)
    D = []
    for component in ("D_x", "D_y"):
        equation = Component(component, PARAMETERS)
        c = equation.basis @ equation.coefficients(equation.parameters_of(world.truth), delays(world))
        D.append([columns_of(noise[:, :, i], f, world)[0] @ c for i in range(noise.shape[-1])])
    power = np.array(D) @ np.conj(D).T
    np.testing.assert_allclose(np.sqrt(np.diag(power).real), [8.1e-14, 1.4e-13], rtol=0.1)
    assert abs(power[0, 1]) < 0.05 * np.sqrt(power[0, 0] * power[1, 1]).real


def test_assemblies_that_turn_are_taken_off_the_attitude():
    still = lisa_loop.run(World(), lisa_loop.sequence(1e-6), duration=3600)
    turning = {j: 1e-6 * np.sin(0.01 * j * still.time) for j in (1, 2)}
    channels = {f"mosa_{j}": angle for j, angle in turning.items()}
    channels |= {f"dws_phi_{j}": still.channels[f"dws_phi_{j}"] + angle for j, angle in turning.items()}
    run = replace(still, channels={**still.channels, **channels})
    phi = lisa.LISA.channels(still).series["phi"]
    np.testing.assert_allclose(lisa.LISA.channels(run).series["phi"], phi, atol=1e-18)


def test_an_assembly_that_points_elsewhere_turns_its_test_mass():
    # half a milliradian of `opening`, and the same as what the assembly states
    world = World(geometry={"opening": 5e-4})
    f = np.geomspace(1e-4, 0.1, 50)
    outputs, _ = lisa_loop.closed_loop(world, f)
    columns = columns_of(outputs[:, :, lisa_loop.SOURCES.index("r_o_1")], f, world)
    run = lisa_loop.run(world, lisa_loop.sequence(1e-6), duration=3600)
    turned = replace(
        run, channels={**run.channels, "mosa_1": np.full(run.size, 5e-4), "mosa_2": 0 * run.time}
    )
    for equation in LISA.equations(LISA.channels(turned)):
        theta = equation.parameters_of(world.truth)
        terms = columns @ equation.basis * equation.coefficients(theta, delays(world))
        assert np.all(np.abs(terms.sum(axis=1)) < 1e-12 * np.abs(terms).max())


def test_geometry_that_is_no_number_is_refused():
    run = lisa_loop.run(World(), lisa_loop.sequence(1e-6), duration=3600)
    with pytest.raises(InputError, match=r"attribute d_y: 'half a metre', expected a number"):
        lisa.LISA.channels(replace(run, attributes={"d_y": "half a metre"}))
