"""Archives as users have them: what a map makes of them is the telemetry they were written from, and its t0.

Time stamps are written by `astropy.time` from the instants of an exact grid, and rounded as archives do it.
"""

import h5py
import numpy as np
import pytest
import xarray
from astropy.time import Time, TimeDelta

from fit.errors import InputError
from fit.telemetry.contract import LISA_REQUIRED
from fit.telemetry.reader import read
from tests.fit.telemetry.mapped import M_TM, T0, N, assert_same, instants, isot, listed, write


def posix(times):
    """POSIX time: days of 86400 s, counted in UTC."""
    days = times.ymdhms
    midnight = Time({"year": days["year"], "month": days["month"], "day": days["day"]}, scale="utc")
    return np.round((midnight.mjd - 40587) * 86400 + (times - midnight).to_value("s"), 6).tolist()


STAMPS = {
    "ISO with T": (isot, ""),
    "GPS": (lambda times: np.round(times.gps, 4).tolist(), 'format = "gps"'),
    "Unix": (posix, 'format = "unix"'),
    "MJD": (lambda times: times.mjd.tolist(), 'format = "mjd"'),
    "ISO of TAI": (lambda times: isot(times.tai), 'scale = "tai"'),
}


@pytest.mark.parametrize("stamps", STAMPS)
def test_time_stamps(archive, channels, stamps, fs=10.0):
    spell, keys = STAMPS[stamps]
    write(archive.folder / "A.csv", {"t": spell(instants(fs)), **listed(channels)})
    run = archive.convert(clock=f'column = "t"\n{keys}', t0="")
    assert (run.t0, run.fs) == (T0, fs)
    np.testing.assert_array_equal(run.time, np.arange(N) / fs)
    assert_same(run, channels)


@pytest.mark.parametrize("stamps", ["ISO with T", "GPS"])
def test_a_run_over_a_leap_second_is_uniform(archive, channels, stamps):
    spell, keys = STAMPS[stamps]
    times = instants(10.0, "2016-12-31T23:58:00")
    assert times[1205].isot == "2016-12-31T23:59:60.500"
    write(archive.folder / "A.csv", {"t": spell(times), **listed(channels)})
    run = archive.convert(clock=f'column = "t"\n{keys}', t0="")
    assert (run.t0, run.fs, run.time[-1]) == ("2016-12-31T23:58:00Z", 10.0, (N - 1) / 10)


def test_a_t0_that_is_stated_too(archive, channels):
    write(archive.folder / "A.csv", {"t": isot(instants(1.0)), **listed(channels)})
    assert archive.convert(t0="2016-04-16T14:00:00.4Z").t0 == T0
    message = archive.refusal(t0="2016-04-16T15:00:00Z")
    assert message.startswith(
        "map.toml: runs[0].t0: '2016-04-16T15:00:00+00:00' is 3600 s after the first time stamp"
    )


def write_netcdf(path, channels, units):
    """Write what xarray writes: times that count from an epoch."""
    times = np.datetime64("2016-04-16T14:00:00", "ns") + (1e8 * np.arange(N)).astype("m8[ns]")
    data = xarray.Dataset({k: ("time", v) for k, v in channels.items()}, {"time": times})
    data.to_netcdf(path, engine="h5netcdf", encoding={"time": {"units": units, "dtype": "i8"}})


@pytest.mark.parametrize("epoch", ["2016-04-16 00:00:00", "2016-01-01", "2016-04-16T14:00:00+02:00"])
def test_t0_follows_from_the_epoch_of_netcdf(archive, channels, epoch):
    write_netcdf(archive.folder / "A.nc", channels, f"milliseconds since {epoch}")
    run = archive.convert(run='file = "A.nc"', clock='column = "time"', t0="")
    assert (run.t0, run.fs) == (T0, 10.0)
    assert_same(run, channels)
    message = archive.refusal(run='file = "A.nc"', clock='column = "time"', t0="2016-04-16T12:00:00Z")
    assert "is 7200 s before the first time stamp" in message


def shift(times, sample, seconds):
    return times + TimeDelta(seconds * (np.arange(N) >= sample), format="sec")


TIME_FAULTS = {
    "a gap": (
        lambda t: isot(shift(t, 900, 0.1)),
        "",
        "from 89.9 s to 90.1 s at sample 900, expected uniform",
    ),
    "single precision": (
        lambda t: t.gps.astype("f4").astype(float).tolist(),
        'format = "gps"',
        "rounded to 128 s, which does not resolve samples",
    ),
    "a GPS week": (lambda t: (t.gps % 604800).tolist(), 'format = "gps"', "begins at 1980-01-1"),
}


@pytest.mark.parametrize("fault", TIME_FAULTS)
def test_a_fault_of_time_stamps(archive, channels, fault):
    spell, keys, expected = TIME_FAULTS[fault]
    write(archive.folder / "A.csv", {"t": spell(instants(10.0)), **listed(channels)})
    message = archive.refusal(clock=f'column = "t"\n{keys}')
    assert message.startswith("A.csv: column t: ") and expected in message, message


# Missing samples -----------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("name", "value"),
    [
        *[("f_x_1", -9999), ("f_x_2", 999), ("o_1", 9.96921e36), ("o_12", -123456.789)],
        ("o_12", float(np.float32(-9999.9))),
    ],
)
def test_the_map_that_a_message_asks_for_is_enough(archive, channels, name, value):
    columns = {key: values / values.std() for key, values in channels.items()}
    columns[name][50:900:200] = value
    units = {key: "nm" if key[0] == "o" else "pm s-2" for key in channels}
    write(archive.folder / "A.csv", {"t": np.arange(N).tolist(), **listed(columns)})
    described = {key: f'{{ column = "{key}", unit = "{unit}" }}' for key, unit in units.items()}
    message = archive.refusal(columns=described)
    assert f"A.csv: column {name} (channel {name}): {value:.7g} at sample 50, 5 times in all" in message
    cure = message.partition("expected ")[2].partition(" in the map")[0]
    for missing, top in ((f", {cure}", ""), ("", cure)):
        chosen = described | {name: described[name].replace(" }", f"{missing} }}")}
        run = archive.convert(columns=chosen, top=top)
        assert np.flatnonzero(np.isnan(run.channels[name])).tolist() == list(range(50, 900, 200))


def test_a_marker_in_telemetry(archive, channels):
    write(archive.folder / "A.csv", {"t": np.arange(N).tolist(), **listed(channels)})
    path = archive.convert().path
    with h5py.File(path, "r+") as file:
        file["o_12"][50::500] = -9999.0
        file["o_12"].attrs["missing_value"] = 9.96921e36  # states another marker, not that there is none
    with pytest.raises(
        InputError,
        match=r"A\.h5: channel o_12: -9999 at sample 50, 5 times .* seems to mark missing samples",
    ):
        read(path)


# Units and columns ---------------------------------------------------------------------------------------


def write_with_unit(archive, channels, unit):
    """Write an archive whose column o_1 states a unit."""
    names = {"o_1": f"o_1 [{unit}]"} if unit else {}
    columns = {names.get(name, name): values for name, values in channels.items()}
    write(archive.folder / "A.csv", {"t": (np.arange(N) / 10).tolist(), **listed(columns)})


@pytest.mark.parametrize(
    ("of_file", "of_map", "factor"), [("pm", "", 1e-12), ("pm", "pm", 1e-12), ("counts", "nm", 1e-9)]
)
def test_the_unit_of_a_column(archive, channels, of_file, of_map, factor):
    write_with_unit(archive, channels, of_file)
    unit = f', unit = "{of_map}"' if of_map else ""
    run = archive.convert(columns={"o_1": f'{{ column = "o_1"{unit} }}'})
    np.testing.assert_allclose(run.channels["o_1"], channels["o_1"] * factor, rtol=1e-12)


@pytest.mark.parametrize(
    ("columns", "words"),
    [
        ({"o_1": '{ column = "o_1", unit = "nm" }'}, "(channel o_1): in 'pm' by the file, 'nm' by the map"),
        ({"o_12": '{ column = "o_1" }'}, "(channel o_12): also that of channel o_1, expected a column"),
    ],
    ids=["unit of file and map", "two channels of one column"],
)
def test_columns_that_contradict_the_map_are_refused(archive, channels, columns, words):
    write_with_unit(archive, channels, "pm")
    assert words in archive.refusal(columns=columns)


def test_a_channel_of_one_value(archive, channels):
    write_with_unit(archive, channels, "")
    for column, value in (("{ value = 0 }", 0.0), ('{ value = 1.5, unit = "pN/kg" }', 1.5e-12)):
        run = archive.convert(columns={"f_x_1": column})
        np.testing.assert_allclose(run.channels["f_x_1"], np.full(N, value), rtol=1e-15)
        assert_same(run.select(["f_x_2"]), {"f_x_2": channels["f_x_2"]})
    for column, words in {
        "{ value = 1.5 }": "channels.f_x_1.unit: value 1.5 without a unit",
        '{ value = 0, column = "f_x_1" }': "channels.f_x_1: expected its column",
        "{ }": "channels.f_x_1: expected its column",
        "{ value = nan }": "channels.f_x_1.value: NaN, expected a finite number",
    }.items():
        assert words in archive.refusal(columns={"f_x_1": column})


def test_forces_are_divided_by_the_mass(archive, channels):
    forces = {name: channels[name] * M_TM * 1e12 for name in ("f_x_1", "f_x_2")}
    write(archive.folder / "A.csv", {"t": np.arange(N).tolist(), **listed(channels | forces)})
    run = archive.convert(
        columns=dict.fromkeys(forces, "") | {n: f'{{ column = "{n}", unit = "pN" }}' for n in forces}
    )
    assert_same(run, channels, rtol=1e-14)
    assert run.units["f_x_1"] == "m s-2"
    for unit in ("m/s", "pN m", "N/m"):
        message = archive.refusal(columns={"f_x_1": f'{{ column = "f_x_1", unit = "{unit}" }}'})
        assert f"map.toml: channels.f_x_1.unit: unit '{unit}' does not measure what 'm s-2' does" in message
        assert "expected 'm s-2', 'N' or a multiple of it" in message


def test_channels_of_lisa(archive):
    rng = np.random.default_rng(7)
    channels = {name: rng.normal(0.0, 1e-9, N) for name in LISA_REQUIRED}
    write(archive.folder / "A.csv", {"t": np.arange(N).tolist(), **listed(channels)})
    run = archive.convert(names=LISA_REQUIRED, attributes='half_opening = "30 deg"')
    assert (run.spacecraft, run.attributes["half_opening"]) == ("LISA", pytest.approx(np.pi / 6))
    assert_same(run, channels)


def test_a_fault_is_one_sentence_of_the_command_and_leaves_nothing(lpfcosim, archive, channels):
    write(archive.folder / "A.csv", {"t": np.arange(N).tolist(), **listed(channels)})
    archive.refusal(columns={"o_12": '{ column = "o_2" }'})
    _, out, err = lpfcosim("fit", "map.toml", "--out", "result", status=2)
    (sentence,) = err.splitlines()
    assert sentence.startswith("lpfcosim: error: A.csv: column o_2 (channel o_12): missing, did you mean")
    assert out == "" and {file.name for file in archive.folder.iterdir()} == {"map.toml", "A.csv"}
