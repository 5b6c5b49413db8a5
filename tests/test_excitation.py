"""Excitations keep what they promise: lines, limits, rates, orthogonality."""

import dataclasses

import numpy as np
import pytest
from scipy.signal import hilbert

from alssnn import cli
from alssnn.excitation import Excitation, multisine, prbs, steps, swept_sine
from alssnn.tables import read_csv

MAKERS = {
    "multisine": lambda **k: multisine(128, **k),
    "steps": lambda **k: steps(200, **k),
    "prbs": lambda **k: prbs(6, **k),
    "swept_sine": lambda **k: swept_sine(200, **k),
}


def spectra(excitation):
    """Return the spectra (experiments, lines from 0, nu) of the first periods."""
    periods = [u[: excitation.period] for u in excitation.experiments]
    return np.fft.rfft(periods, axis=1)


# -- what all have in common -----------------------------------------------------------


@pytest.mark.parametrize("make", MAKERS.values(), ids=MAKERS)
def test_limits_and_rates_are_kept_and_reached(make):
    low, high, point = np.array([-1.0, 2.0]), np.array([3.0, 2.5]), [0.0, 2.2]
    excitation = make(
        nu=2, low=low, high=high, operating_point=point, dt=0.1, random_state=0
    )
    u = excitation.u
    assert np.all((low <= u) & (u <= high))
    # a limit is nearly reached, on the side of less room at least
    room = np.minimum(high - u.max(axis=0), u.min(axis=0) - low)
    assert np.all(room < 0.3 * (high - low))
    slow = make(
        nu=2,
        low=low,
        high=high,
        operating_point=point,
        dt=0.1,
        rate=0.3,
        random_state=0,
    )
    change = [np.abs(np.diff(u, axis=0)).max() for u in slow.experiments]
    assert max(change) <= 0.3 * 0.1 * (1 + 1e-9)
    assert max(change) > 0.5 * 0.3 * 0.1
    assert np.all((low <= slow.u) & (slow.u <= high))


@pytest.mark.parametrize("make", MAKERS.values(), ids=MAKERS)
def test_periods_repeat_and_labels_count_experiments(make):
    excitation = make(nu=2, n_periods=3, n_realizations=2, rate=0.4, random_state=0)
    assert set(excitation.experiment) == set(range(excitation.n_experiments))
    assert set(excitation.realization) == {0, 1}
    for u in excitation.experiments:
        assert len(u) == 3 * excitation.period
        first, second, third = np.split(u, 3)
        np.testing.assert_array_equal(first, second)
        np.testing.assert_array_equal(first, third)
    # the seam of two periods is no jump, either
    assert np.abs(np.diff(u, axis=0)).max() <= 0.4 * (1 + 1e-9)


@pytest.mark.parametrize("make", MAKERS.values(), ids=MAKERS)
def test_a_seed_gives_one_signal_that_cannot_be_changed(make):
    one, two, other = (make(n_realizations=2, random_state=s) for s in (0, 0, 1))
    np.testing.assert_array_equal(one.u, two.u)
    assert np.any(one.u != other.u)
    assert not one.u.flags.writeable
    with pytest.raises(ValueError, match="read-only"):
        one.u[0] = 0
    with pytest.raises(dataclasses.FrozenInstanceError):
        one.dt = 2.0


@pytest.mark.parametrize("make", MAKERS.values(), ids=MAKERS)
def test_a_file_holds_the_same_numbers(make, tmp_path):
    excitation = make(nu=2, names=["valve", "pump"], dt=0.1, random_state=0)
    excitation.to_csv(tmp_path / "u.csv")
    t, _, labels = read_csv(tmp_path / "u.csv", ["time"], [], "experiment")
    u, _, _ = read_csv(tmp_path / "u.csv", ["valve", "pump"], [])
    np.testing.assert_array_equal(u, excitation.u)
    np.testing.assert_array_equal(labels, excitation.experiment.astype(str))
    np.testing.assert_allclose(t[:, 0], 0.1 * np.arange(len(u)), rtol=1e-11)


@pytest.mark.parametrize("make", MAKERS.values(), ids=MAKERS)
def test_the_figure_shows_limits_and_spectrum(make):
    display = make(nu=2, low=-3, n_realizations=3, random_state=0).plot()
    assert display.axes_.shape == (2, 2)
    signal, spectrum = display.axes_[0]
    assert len(signal.lines) == 4  # two realizations, two limits
    assert [line.get_ydata()[0] for line in signal.lines[2:]] == [-3, 1]
    assert len(spectrum.lines) == 2
    with pytest.raises(ValueError, match="`ax` must hold 4 axes"):
        display.plot(ax=signal)


# -- multisines ------------------------------------------------------------------------


@pytest.mark.parametrize("grid", ["full", "odd", "odd-random"])
@pytest.mark.parametrize("reduce_crest", [False, True])
def test_only_lines_of_the_grid_are_excited(grid, reduce_crest):
    excitation = multisine(
        256,
        dt=0.1,
        band=(0.5, 3),
        grid=grid,
        spectrum=lambda f: 1 / f,
        reduce_crest=reduce_crest,
        random_state=0,
    )
    lines = excitation.lines
    power = np.abs(spectra(excitation)[:, :, 0])
    power[:, 0] = 0  # the operating point
    assert np.all(np.delete(power, lines, axis=1) < 1e-9 * power.max())
    # the spectrum that was asked for, the same in all realizations
    scaled = power[:, lines] * excitation.frequencies
    np.testing.assert_allclose(scaled, scaled[0, 0], rtol=1e-9)
    assert excitation.frequencies[0] >= 0.5 and excitation.frequencies[-1] <= 3
    odd = np.arange(13, 77, 2)  # 0.5 to 3 Hz in steps of 1 / 25.6 Hz
    if grid == "full":
        np.testing.assert_array_equal(lines, np.arange(13, 77))
    elif grid == "odd":
        np.testing.assert_array_equal(lines, odd)
    else:
        omitted = np.setdiff1d(odd, lines)
        assert len(omitted) == 8  # one of every four
        np.testing.assert_array_equal(np.searchsorted(odd, omitted) // 4, np.arange(8))


@pytest.mark.parametrize("nu", [1, 2, 3, 4, 5])
def test_inputs_are_orthogonal_over_the_experiments_of_a_realization(nu):
    excitation = multisine(64, nu, n_realizations=2, random_state=0)
    U = spectra(excitation)[:, excitation.lines].reshape(2, nu, -1, nu)
    gram = np.einsum("mkfi,mkfj->mfij", U, U.conj())
    diagonal = np.einsum("mfii->mfi", gram).real
    np.testing.assert_allclose(diagonal, diagonal[0, 0] * np.ones_like(diagonal))
    off = gram - diagonal[..., None] * np.eye(nu)
    assert np.abs(off).max() < 1e-12 * diagonal.max()


@pytest.mark.parametrize("nu", [1, 2, 3])
def test_peaks_are_lowered(nu):
    options = {"nu": nu, "n_realizations": 1, "random_state": 0}
    rough = multisine(512, **options).crest_factor
    low = multisine(512, reduce_crest=True, **options).crest_factor
    assert np.all(low < 1.8) and np.all(rough > 2.5)


def test_phases_are_uniform_and_independent():
    excitation = multisine(256, n_realizations=400, random_state=0)
    U = spectra(excitation)[:, excitation.lines, 0]
    phase = U / np.abs(U)
    # means of n unit vectors: smaller than 4 / sqrt(n) but for chance
    assert np.abs(phase.mean(axis=0)).max() < 4 / np.sqrt(400)
    assert np.abs((phase[:, 1:] * phase[:, :-1].conj()).mean()) < 4 / np.sqrt(U.size)


# -- the others ------------------------------------------------------------------------


def test_steps_hold_as_long_as_they_are_told():
    excitation = steps(5000, 2, dt=0.5, hold=(2, 10), low=0, random_state=0)
    for column in excitation.u.T:
        lengths = np.diff(np.flatnonzero(np.diff(column)))
        assert lengths.min() == 4 and lengths.max() == 20  # samples
        assert column[0] == 0.5  # at the operating point
    heights = np.unique(excitation.u)
    assert heights.min() < 0.02 and heights.max() > 0.98


def test_a_binary_sequence_has_two_levels_and_a_flat_spectrum():
    excitation = prbs(7, 3, random_state=0)
    assert excitation.period == 127 and set(excitation.u.ravel()) == {-1, 1}
    u = excitation.u[:127]
    # periodic autocorrelation of a sequence of maximum length: -1 but at lag zero
    for column in u.T:
        product = np.fft.ifft(np.abs(np.fft.fft(column)) ** 2).real
        np.testing.assert_allclose(product, [127, *[-1] * 126], atol=1e-9)
    assert np.abs(u.T @ u - np.diag([127] * 3)).max() < 1.5
    held = prbs(5, hold=3, random_state=0)
    assert np.unique(np.diff(np.flatnonzero(np.diff(held.u[:, 0]))) % 3).tolist() == [0]


def test_a_single_sweep_need_not_come_back():
    """Where it ends is far from its beginning; the rate counts between samples."""
    for n in (1000, 1234):
        options = {"dt": 0.01, "band": (0.1, 2), "rate": 5}
        once, twice = (swept_sine(n, n_periods=p, **options).u for p in (1, 2))
        for u in (once, twice):
            fastest = np.abs(np.diff(u[:, 0])).max() / 0.01
            assert fastest == pytest.approx(5)
        assert 0.4 < once.max() < 0.45  # 5 / (2 pi 2) = 0.398, between samples
        assert np.abs(once[0] - once[-1]) > 0.05 and twice.max() < 0.1


def test_a_sweep_passes_its_band():
    excitation = swept_sine(4000, 2, dt=0.01, band=(0.5, 8), n_realizations=2)
    assert excitation.n_experiments == 4
    for m, u in enumerate(excitation.experiments):
        assert not np.any(u[:, 1 - m % 2])  # the other input rests
        phase = np.unwrap(np.angle(hilbert(u[:, m % 2])))
        f = np.gradient(phase, 0.01) / (2 * np.pi)
        assert np.median(f[50:250]) == pytest.approx(0.55, rel=0.15)
        assert np.median(f[-250:-50]) == pytest.approx(7.2, rel=0.1)


# -- errors ----------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("call", "message"),
    [
        (lambda: multisine(low=1, high=-1), "`low` must be below `high`"),
        (lambda: multisine(2, 2), "`period` must be an integer of at least 8"),
        (lambda: multisine(nu=0), "`nu` must be an integer of at least 1"),
        (lambda: multisine(n_periods=0), "`n_periods` must be an integer"),
        (lambda: multisine(n_realizations=1.5), "`n_realizations` must be an integer"),
        (lambda: multisine(dt=0), "`dt` must be a positive number"),
        (lambda: multisine(band=(0, 0.5)), "below the Nyquist frequency, 0.5 Hz"),
        (lambda: multisine(band=(0.3, 0.1)), "`band` must be a pair"),
        (lambda: multisine(band=3), "`band` must be a pair"),
        (lambda: multisine(64, band=(0.101, 0.102)), "`band` must contain a line"),
        (lambda: multisine(grid="even"), "`grid` must be 'full', 'odd'"),
        (
            lambda: multisine(64, band=(0, 0.05), grid="odd-random"),
            "at least `group` = 4 odd lines, got 2",
        ),
        (lambda: multisine(grid="odd-random", group=1), "`group` must be an integer"),
        (lambda: multisine(spectrum=[1, 2]), r"shape \(409,\) or \(409, 1\)"),
        (lambda: multisine(spectrum=lambda f: 0 * f), "`spectrum` must be positive"),
        (lambda: multisine(nu=2, low=[0, 0, 0]), "`low` must be a finite number or 2"),
        (lambda: multisine(high=np.inf), "`high` must be a finite number"),
        (lambda: multisine(operating_point=1), "`operating_point` must lie between"),
        (lambda: multisine(rate=0), "`rate` must be positive"),
        (lambda: multisine(names=["a", "b"]), "`names` must be 1 different names"),
        (lambda: multisine(nu=2, names=["a", "a"]), "`names` must be 2 different"),
        (lambda: multisine(names=["time"]), "none of them time"),
        (lambda: steps(0), "`n_samples` must be an integer of at least 1"),
        (lambda: steps(10, hold=(0.1, 2)), "`hold` must be an increasing pair"),
        (lambda: steps(10, hold=3), "`hold` must be an increasing pair"),
        (lambda: prbs(30), "`n_bits` must be from 2 to 20, got 30"),
        (lambda: prbs(hold=0), "`hold` must be an integer"),
        (lambda: swept_sine(100, method="cubic"), "`method` must be 'linear'"),
        (lambda: swept_sine(100, band=(0, 0.1)), "`band` must begin above 0 Hz"),
    ],
)
def test_wrong_arguments_are_named(call, message):
    with pytest.raises(ValueError, match=message):
        call()


# -- the command -----------------------------------------------------------------------


def excite(*argv):
    return cli.main(["excite", *map(str, argv)])


@pytest.mark.parametrize(
    ("kind", "options", "expected"),
    [
        ("multisine", ["--period", 64, "--grid", "odd"], {"period": 64}),
        ("steps", ["--samples", 50, "--hold", 2, 9], {"period": 50}),
        ("prbs", ["--bits", 4, "--bit-samples", 2], {"period": 30}),
        ("swept-sine", ["--samples", 50, "--band", 0.01, 0.1], {"period": 50}),
    ],
)
def test_the_command_writes_what_the_functions_make(
    kind, options, expected, tmp_path, capsys
):
    path = tmp_path / "new" / "u.csv"
    names = ["--input", "valve", "pump", "--low", 0, "--high", 10, 5]
    assert excite(kind, *names, *options, "--at", 1, "--rate", 2, "-o", path) == 0
    u, _, labels = read_csv(path, ["valve", "pump"], [], "experiment")
    assert u.min() >= 0 and np.all(u.max(axis=0) <= [10, 5])
    out = capsys.readouterr().out
    assert f"N={len(u)}" in out and str(path) in out
    assert len(u) % expected["period"] == 0 and len(set(labels)) >= 1


def test_the_command_draws(tmp_path):
    figure = tmp_path / "u.png"
    assert excite("prbs", "-o", tmp_path / "u.csv", "--figure", figure) == 0
    assert figure.stat().st_size > 1000


@pytest.mark.parametrize(
    ("argv", "message"),
    [
        (["steps"], "steps needs --samples"),
        (["steps", "--samples", 9, "--band", 0, 1], "band does not belong to steps"),
        (["prbs", "--hold", 1, 2], "take --bit-samples"),
        (["multisine", "--hold", 1, 2], "hold does not belong to multisine"),
    ],
)
def test_what_belongs_to_another_signal_is_an_error(argv, message, capsys):
    with pytest.raises(SystemExit):
        excite(*argv)
    assert message in capsys.readouterr().err


def test_wrong_limits_end_in_one_line(tmp_path, capsys):
    assert excite("multisine", "--low", 2, "-o", tmp_path / "u.csv") == 2
    assert "`low` must be below `high`" in capsys.readouterr().err


def test_an_excitation_has_a_length():
    excitation = steps(100, random_state=0)
    assert isinstance(excitation, Excitation) and len(excitation) == 100
