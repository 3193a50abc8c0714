import h5py
import numpy as np
import pytest

from fit.errors import InputError
from fit.telemetry.reader import read, read_all, read_truth
from tests.oracles.contract_file import UNITS, write_contract_file

N = 200


@pytest.fixture
def file(tmp_path):
    return write_contract_file(tmp_path / "A1.h5", samples=N)


def refusal(path):
    """Return the message of the refusal; it must be one sentence that names the file."""
    with pytest.raises(InputError) as caught:
        read(path)
    message = str(caught.value)
    assert message.startswith(str(path))
    assert "\n" not in message
    assert "expected" in message
    return message.removeprefix(str(path))


def test_a_valid_file(tmp_path):
    o_1 = np.linspace(-1e-9, 1e-9, N)
    path = write_contract_file(
        tmp_path / "A1.h5",
        samples=N,
        channels={"o_1": (o_1, "m"), "counter": (np.arange(N), ""), "F_x_sc": (np.ones(N), "N")},
        seed=7,
        version="0.1.0",
    )
    telemetry = read(path)
    assert (telemetry.run, telemetry.experiment, telemetry.kind) == ("A1", "A1", "sysid")
    assert (telemetry.fs, telemetry.duration, telemetry.alignment_epoch) == (10.0, 20.0, 1)
    assert (telemetry.F_max_2, telemetry.N_max_1, telemetry.m_tm) == (2200e-12, 10.4e-12, 1.928)
    np.testing.assert_array_equal(telemetry.channels["o_1"], o_1)
    np.testing.assert_array_equal(telemetry.channels["counter"], np.arange(N))
    assert telemetry.channels["counter"].dtype == np.float64
    assert telemetry.channels.keys() == {*UNITS, "counter", "F_x_sc"}
    assert telemetry.units["f_x_2"] == "m s-2"
    assert telemetry.attributes == {"seed": 7, "version": "0.1.0"}
    assert telemetry.time[1] == 0.1


def test_what_is_no_channel_is_left_alone(file):
    with h5py.File(file, "a") as h5:
        h5["scalar"] = 3.0
        h5["image"] = np.zeros((N, 3))
        h5["names"] = np.array([b"x"] * N)
        h5.create_group("other")["o_1"] = 1.0
        h5["frequency"] = np.arange(7.0)
        h5["frequency"].make_scale("frequency")
        h5["psd"] = np.ones(7)
        h5["psd"].dims[0].attach_scale(h5["frequency"])
        h5["gap"] = np.full(N, np.nan)
        h5["broken"] = h5py.SoftLink("/nowhere")
    assert read(file).channels.keys() == {*UNITS, "gap"}


ATTRIBUTE_FAULTS = [
    ("schema", "lpf-telemetry/2", "'lpf-telemetry/2', expected 'lpf-telemetry/1'"),
    ("t0", "2016-04-16", "'2016-04-16', expected date and time"),
    ("fs", "10", "fs: '10'"),
    ("fs", np.array([10.0, 10.0]), "fs: array"),
    ("inertial_period", np.nan, "inertial_period: nan"),
]


@pytest.mark.parametrize(("name", "value", "expected"), ATTRIBUTE_FAULTS)
def test_faults_of_root_attributes(file, name, value, expected):
    with h5py.File(file, "a") as h5:
        h5.attrs.pop(name, None)
        if value is not None:
            h5.attrs[name] = value
    message = refusal(file)
    assert f"attribute {name}" in message
    assert expected in message


def replace(h5, name, values, units="m"):
    if name in h5:
        del h5[name]
    h5[name] = values
    h5[name].attrs["units"] = units


def with_value(h5, name, index, value):
    h5[name][index] = value


def put(h5, name, **options):
    """Replace a channel by a dataset of other storage."""
    del h5[name]
    h5.create_dataset(name, **options).attrs["units"] = "m"


def virtual(h5):
    layout = h5py.VirtualLayout((N,), "f8")
    layout[:] = h5py.VirtualSource(h5["o_12"])
    del h5["o_1"]
    h5.create_virtual_dataset("o_1", layout).attrs["units"] = "m"


def link(h5):
    del h5["o_1"]
    h5["o_1"] = h5py.ExternalLink("/etc/passwd", "/o_1")


def unwritten(h5):
    """Declare four chunks and write three."""
    put(h5, "o_1", shape=(N,), dtype="f8", chunks=(N // 4,))
    h5["o_1"][N // 4 :] = 1e-9


CHANNEL_FAULTS = {
    "missing": (lambda h5: h5.pop("f_x_2"), ["channel f_x_2: missing"]),
    "nm": (lambda h5: h5["o_12"].attrs.update(units="nm"), ["channel o_12", "'nm'", "'m'"]),
    "short": (lambda h5: put(h5, "o_1", data=np.zeros(N - 1)), ["channel o_1: 199", "200"]),
    "beyond all": (lambda h5: with_value(h5, "o_1", 3, 1e308), ["channel o_1: 1e+308 at sample 3"]),
    "link": (link, ["channel o_1: a link, expected the dataset itself"]),
    "virtual": (virtual, ["channel o_1: kept in other files"]),
    "elsewhere": (
        lambda h5: put(h5, "o_1", shape=(N,), dtype="f8", external=[("/dev/zero", 0, 8 * N)]),
        ["channel o_1: kept in other files"],
    ),
    "a terabyte": (
        lambda h5: put(h5, "o_1", shape=(10**12,), dtype="f8", chunks=(1000,)),
        ["channel o_1: 1000000000000 samples, expected the 200 of time"],
    ),
    "unwritten": (
        lambda h5: put(h5, "o_1", shape=(N,), dtype="f8"),
        ["channel o_1: declared but never written"],
    ),
    "a chunk unwritten": (unwritten, [f"channel o_1: declared but only {N - N // 4} values of {N} written"]),
    "too many nan": (
        lambda h5: with_value(h5, "o_12", slice(42, 45), np.nan),
        ["channel o_12: nan from sample 42 (t = 4.2 s)", "1.5 %", "0.3 s", "expected at most 1 % and 600 s"],
    ),
}


@pytest.mark.parametrize("fault", CHANNEL_FAULTS)
def test_faults_of_channels(file, fault):
    mutate, expected = CHANNEL_FAULTS[fault]
    with h5py.File(file, "a") as h5:
        mutate(h5)
    message = refusal(file)
    for part in expected:
        assert part in message


@pytest.mark.parametrize(("gap", "accepted"), [(600, True), (601, False)])
def test_missing_samples_up_to_one_per_cent_and_ten_minutes_are_kept(tmp_path, gap, accepted):
    o_1 = np.zeros(80_000)
    o_1[1000 : 1000 + gap] = np.nan
    path = write_contract_file(tmp_path / "gap.h5", samples=80_000, fs=1.0, channels={"o_1": (o_1, "m")})
    if accepted:
        np.testing.assert_array_equal(read(path).channels["o_1"], o_1)
    else:
        assert "gaps of up to 601 s" in refusal(path)


@pytest.mark.parametrize(("kind", "begin"), [("f4", 0.0), ("f8", 3600.05)])
def test_a_time_axis_that_single_precision_rounded_is_exact_again(tmp_path, kind, begin):
    size = 216_000  # 6 h at 10 Hz, where steps are 0.002 s
    path = write_contract_file(tmp_path / "A1.h5", samples=size)
    exact = begin + np.arange(size) / 10
    with h5py.File(path, "a") as h5:
        replace(h5, "time", exact.astype("f4").astype(kind), "s")
    loaded = read(path).time
    assert (
        np.abs(np.diff(exact.astype("f4").astype("f8")) - 0.1).max() > 1e-3
    )  # of which the tolerance is 1e-4
    np.testing.assert_allclose(loaded, exact, rtol=0, atol=1e-4)
    np.testing.assert_allclose(np.diff(loaded), 0.1, rtol=0, atol=1e-9)


SAMPLES = np.arange(N)
TIME_FAULTS = {
    "single precision of GPS seconds": (
        (1.14e9 + SAMPLES * 0.1).astype("f4"),
        "rounded to 128 s, which does not resolve samples 0.1 s apart",
    ),
    "a sample lost in single precision": (
        (2e4 + 0.1 * (SAMPLES + (SAMPLES > 9))).astype("f4"),
        "at sample 10, expected uniform steps",
    ),
    "jump": (0.1 * SAMPLES + 3 * (SAMPLES >= 100), "sample 100"),
    "drift within the tolerance of a step": (0.1 * (1 + 5e-4) * SAMPLES, "spans"),
    "nan": (np.where(SAMPLES == 3, np.nan, 0.1 * SAMPLES), "time: nan at sample 3"),
}


@pytest.mark.parametrize("fault", TIME_FAULTS)
def test_faults_of_time(file, fault):
    values, expected = TIME_FAULTS[fault]
    with h5py.File(file, "a") as h5:
        replace(h5, "time", values if values.dtype.kind == "S" else values.astype("f8"), "s")
    assert expected in refusal(file)


def test_runs_are_sorted_by_start_then_name(tmp_path):
    starts = {"c": "2016-05-02T00:00:00Z", "b": "2016-05-01T00:00:00", "a": "2016-05-01T02:00:00+02:00"}
    files = [write_contract_file(tmp_path / f"{run}.h5", run=run, t0=t0) for run, t0 in starts.items()]
    assert [t.run for t in read_all(files)] == ["a", "b", "c"]


def test_truth(tmp_path):
    truth = {"lambda_2": 1.0776, "alignment": "good", "C_2": np.array([0.186]), "bad": np.nan}
    path = write_contract_file(tmp_path / "A1.h5", truth=truth)
    assert read_truth(path) == {"lambda_2": 1.0776, "C_2": 0.186}
    assert read_truth(write_contract_file(tmp_path / "flight.h5")) == {}


# --- values that are not what they look like ------------------------------------------------------------


@pytest.mark.parametrize(
    ("name", "attribute", "value", "expected"),
    [
        ("o_12", "scale_factor", 1e-9, "1e-09, expected the values themselves"),
        ("time", "add_offset", 0.5, "0.5, expected the values themselves"),
        (
            "f_x_2",
            "_FillValue",
            -9999.0,
            "-9999.0 stands for missing samples, such as number 17, expected NaN",
        ),
        ("f_x_2", "missing_value", -9999.0, "-9999.0 stands for missing samples, such as number 17"),
    ],
)
def test_packed_values_and_numbers_for_missing_samples_are_refused(file, name, attribute, value, expected):
    with h5py.File(file, "a") as h5:
        h5["f_x_2"][17] = -9999.0
        h5[name].attrs[attribute] = value
    assert f"{name}: attribute {attribute}: {expected}" in refusal(file)
