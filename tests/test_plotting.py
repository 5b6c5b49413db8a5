from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from matplotlib.figure import Figure

from alssnn.ladder import Ladder, Rung
from alssnn.plotting import plot_ladder

DT = 0.01  # s
NAMES = ["LTI", "FL-SSNN", "AL-SSNN", "GR-SSNN"]


def make_row(name, y, size, params, rng):
    return Rung(
        name=name,
        model=SimpleNamespace(converged_=True, params_=dict.fromkeys(params)),
        n_params=1,
        rmse_train=np.ones(y.shape[1]),
        rmse_test=np.ones(y.shape[1]),
        fit_percent=np.full(y.shape[1], 100 * (1 - size)),
        linearization_error=np.ones(y.shape[1]),
        spectral_radius=0.9,
        seconds=1.0,
        y_hat=y + size * rng.standard_normal(y.shape),
        e=0.1 * rng.standard_normal(y.shape),
    )


@pytest.fixture
def ladder():
    rng = np.random.default_rng(0)
    y = rng.standard_normal((900, 2))
    nets = ["", "W_h", "W_h W_g", "W_g"]
    rows = tuple(
        make_row(name, y, size, f"A B C {net}".split(), rng)
        for name, size, net in zip(NAMES, [0.5, 0.4, 0.02, 0.01], nets, strict=True)
    )
    return Ladder(rows, y, (slice(0, 300), slice(300, 900)), DT, ["speed", "torque"])


def labels(ax):
    return [text.get_text() for text in ax.get_legend().get_texts()]


def test_draws_three_panels_without_pyplot(ladder, tmp_path):
    axes = plot_ladder(ladder, unit="rad/s")
    assert axes.shape == (3,)
    assert labels(axes[0]) == ["measured", *NAMES]
    assert labels(axes[1])[2] == "AL-SSNN, 2 %"
    spectra = [f"residual of {name}" for name in NAMES]
    assert labels(axes[2]) == ["measured", *spectra, "nonlinear rest e\nof AL-SSNN"]
    assert axes[0].get_ylabel() == "speed [rad/s]"
    assert axes[1].get_ylabel() == "residual, moving RMS [rad/s]"
    assert axes[2].get_ylabel() == "amplitude, RMS per bin [rad/s]"
    assert axes[1].get_xlabel().startswith("time")
    assert axes[2].get_xlabel() == "frequency"
    axes[0].figure.savefig(tmp_path / "ladder.png", dpi=50)
    assert (tmp_path / "ladder.png").stat().st_size > 1000


def test_view_is_centered_on_the_largest_error_of_the_longest_experiment(ladder):
    ladder.rows[0].y_hat[700, 1] += 100
    axes = plot_ladder(ladder, output=1, view=100)
    t = axes[0].lines[0].get_xdata()
    np.testing.assert_allclose(t, DT * np.arange(350, 450))  # of its 600 samples
    np.testing.assert_array_equal(
        axes[0].lines[0].get_ydata(), ladder.y_test[650:750, 1]
    )
    assert axes[0].get_ylabel() == "torque"


def test_a_curve_out_of_view_is_named(ladder):
    """A failed model must not vanish from the picture without a word."""
    rows = [replace(row) for row in ladder.rows]
    rows[1] = replace(rows[1], y_hat=rows[1].y_hat + 1e4)
    y_hat = rows[2].y_hat.copy()
    y_hat[::2] -= 1e4
    rows[2] = replace(rows[2], y_hat=y_hat)
    rows[3] = replace(rows[3], y_hat=np.full_like(y_hat, np.inf))
    found = labels(plot_ladder(replace(ladder, rows=tuple(rows)))[0])
    assert found[1] == "LTI"
    assert found[2].startswith("FL-SSNN\n(out of view: ")
    assert found[3].startswith("AL-SSNN\n(partly out of view: -1e+04 to ")
    assert found[4] == "GR-SSNN\n(diverges)"


def test_view_is_limited_to_the_experiment(ladder):
    axes = plot_ladder(ladder, view=10_000)
    assert len(axes[0].lines[0].get_xdata()) == 600


def test_spectrum_of_a_sine_is_its_rms(ladder):
    t = DT * np.arange(2048)
    y = 3 * np.sin(2 * np.pi * 12.5 * t)[:, None]  # 12.5 Hz is bin 128 of 1024
    flat = replace(ladder.rows[0], y_hat=np.zeros_like(y), e=np.zeros_like(y))
    axes = plot_ladder(Ladder((flat,), y, (slice(0, 2048),), DT))
    f, amplitude = axes[2].lines[0].get_data()
    k = np.argmax(amplitude)
    assert f[k] == pytest.approx(12.5)
    assert amplitude[k] == pytest.approx(3 / np.sqrt(2), rel=1e-6)
    assert axes[0].get_ylabel() == "output"


def test_diverged_and_perfect_models_stay_in_the_legend(ladder):
    lost = replace(
        ladder.rows[0],
        y_hat=np.full_like(ladder.y_test, np.inf),
        fit_percent=np.full(2, -np.inf),
    )
    perfect = replace(ladder.rows[2], y_hat=ladder.y_test.copy())
    unstable = replace(ladder.rows[2], e=np.full_like(ladder.y_test, np.inf))
    axes = plot_ladder(replace(ladder, rows=(lost, perfect, unstable)))
    axes[0].figure.draw_without_rendering()
    assert labels(axes[1])[0] == "LTI, diverged"
    assert [len(line.get_xdata()) for line in axes[1].lines[:2]] == [0, 0]
    low, high = axes[0].get_ylim()
    assert np.abs([low, high]).max() < 2 * np.ptp(ladder.y_test[:, 0])


def test_gaps_of_the_measured_output_are_bridged(ladder):
    t = np.arange(900)
    slow = np.column_stack([np.sin(t / 50), np.cos(t / 50)])
    y = slow.copy()
    y[::3, 1] = np.nan
    rows = tuple(replace(row, y_hat=slow + 0.1) for row in ladder.rows)
    lost = replace(rows[0], y_hat=np.full_like(y, np.nan))
    axes = plot_ladder(replace(ladder, y_test=y, rows=(*rows, lost)), output=1)
    for line in axes[1].lines[:-1]:  # the error is 0.1 everywhere, in gaps, too
        np.testing.assert_allclose(line.get_ydata(), 0.1)
    whole = plot_ladder(replace(ladder, y_test=slow, rows=rows), output=1)
    spectra = [a[2].lines[0].get_ydata()[:5] for a in (axes, whole)]
    np.testing.assert_allclose(*spectra, rtol=0.01)
    assert len(axes[1].lines[-1].get_xdata()) == len(axes[2].lines[5].get_xdata()) == 0
    assert np.isfinite(axes[0].get_ylim()).all()
    nothing = np.full_like(y, np.nan)
    axes = plot_ladder(replace(ladder, y_test=nothing, rows=rows))
    axes[0].figure.draw_without_rendering()


def test_draws_on_given_axes(ladder):
    figure = Figure()
    axes = figure.subplots(1, 3)
    assert plot_ladder(ladder, axes=axes, label="y")[0] is axes[0]
    assert axes[0].get_ylabel() == "y"


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"output": 2}, "`output` must be between 0 and 1, got 2. Columns"),
        ({"output": -1}, "`output` must be between 0 and 1, got -1. Columns"),
        ({"view": 1}, "`view` must be at least 2 samples, got 1. Give"),
        ({"axes": [None]}, r"`axes` must hold three axes, got 1 objects. Make"),
        ({"axes": [1, 2, 3]}, r"`axes` must hold three axes, got 3 objects. Make"),
    ],
)
def test_wrong_arguments(ladder, options, message):
    with pytest.raises(ValueError, match=message):
        plot_ladder(ladder, **options)
