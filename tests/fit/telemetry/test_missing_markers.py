"""Numbers that mark missing samples: real samples near them stay, and a map can state that none does."""

import h5py
import numpy as np
import pytest

from fit.errors import InputError
from fit.telemetry.missing_markers import Extreme, replace_markers
from tests.fit.telemetry.mapped import CHANNELS, N

UNITS = dict(zip(CHANNELS, ("nm", "nm", "pm s-2", "pm s-2"), strict=True))


@pytest.fixture
def columns():
    rng = np.random.default_rng(15)
    return {name: rng.normal(size=N) for name in CHANNELS}


def converted(archive, columns, *, top="", keys="", **units):
    """Telemetry that a map makes of columns in HDF5; `keys` are those of its channel o_12."""
    with h5py.File(archive.folder / "A.hdf5", "w") as file:
        for name, values in columns.items():
            file[name] = values
    keys_by_channel = {"o_12": keys}
    described = {
        name: f'{{ column = "{name}", unit = "{unit}"{keys_by_channel.get(name, "")} }}'
        for name, unit in {**UNITS, **units}.items()
    }
    return archive.convert(
        clock="", columns=described, run='file = "A.hdf5"', top=top, attributes='fs = "10 Hz"'
    )


@pytest.mark.parametrize("marker", [9999.0, -999.9, 32768.0])
def test_real_samples_near_a_marker_stay(marker):
    values = marker + np.arange(-50, 50) * 5e-5 * abs(marker) / 9999
    missing = np.isnan(replace_markers(values, [marker]))
    assert np.flatnonzero(missing).tolist() == [50]
    assert not np.isnan(
        replace_markers(np.nextafter([marker, marker], [np.inf, -np.inf]) * (1 + 1e-12), [marker])
    ).any()


@pytest.mark.parametrize("marker", [-9999.9, 9.96921e36, 0.0, np.inf])
def test_a_marker_in_single_precision_or_scaled_is_found(marker):
    values = np.array([np.float32(marker), marker, marker / 0.1 * 0.1, 1.5])
    assert np.isnan(replace_markers(values, [marker])).tolist() == [True, True, True, False]


@pytest.mark.parametrize(
    ("name", "value"),
    [
        *[("o_12", -9999), ("f_x_1", -9999), ("f_x_2", 999), ("o_1", 9.96921e36)],
        *[("o_12", -123456.789), ("o_12", float(np.float32(-9999.9)))],
    ],
)
def test_the_map_that_a_message_asks_for_is_enough(archive, columns, name, value):
    columns[name][50:900:200] = value
    with pytest.raises(InputError) as refused:
        converted(archive, columns)
    message = str(refused.value)
    assert f"A.hdf5: column {name} (channel {name}): " in message
    assert f"{value:.7g} at sample 50 (t = 5 s), 5 times in all" in message
    cure, _, rest = message.partition("expected ")[2].partition(" in the map")
    assert f"at its top or in channels.{name}, or missing = [] in channels.{name}" in rest
    for place in ({"top": cure}, *([{"keys": f", {cure}"}] if name == "o_12" else [])):
        run = converted(archive, columns, **place)
        assert np.flatnonzero(np.isnan(run.channels[name])).tolist() == list(range(50, 900, 200))


@pytest.mark.parametrize("value", [999.0, -4321.0])
def test_a_channel_without_markers_is_said_to_be_so(archive, columns, value):
    columns["o_12"][[50, 250]] = value
    run = converted(archive, columns, keys=", missing = []")
    np.testing.assert_allclose(run.channels["o_12"], 1e-9 * columns["o_12"], rtol=1e-14)
    with h5py.File(run.path) as file:
        assert [name for name in file if "missing_value" in file[name].attrs] == ["o_12"]
        assert np.isnan(file["o_12"].attrs["missing_value"])
    columns["o_1"][[50, 250]] = value
    with pytest.raises(InputError, match=r"\(channel o_1\): .* seems to mark missing samples"):
        converted(archive, columns, keys=", missing = []")


@pytest.mark.parametrize("step", [999.0, -32768.0])
def test_guidance_may_step_by_any_number(archive, columns, step):
    columns["guidance_o_12"] = np.where(np.arange(N) // 300 % 2, step, 0.0)
    run = converted(archive, columns, guidance_o_12="nm")
    np.testing.assert_allclose(run.channels["guidance_o_12"], 1e-9 * columns["guidance_o_12"], rtol=1e-14)


def test_guidance_is_not_a_fill_value():
    assert Extreme.find(np.where(np.arange(N) % 100, 0.0, -1e20)).is_marker("guidance_o_12")
