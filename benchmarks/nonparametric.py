"""Best linear approximations: do their bands cover, are their levels right?

    python -m benchmarks.nonparametric [--seeds 20] [--quick]

Plants are excited by multisines of 4,096 samples and 0.5 rms, four periods of which
one settles, with white noise of 1 % at the output: eight realizations of all lines for
the robust method, one realization of an odd random grid for the fast one.  The truth is
the mean over 2,000 noise-free realizations of the same lines (300 of every grid for the
fast method); that of linear plants is known.  Counted is how often 95 % circles around
G, and 95 % bands of |G|, cover the truth.  Levels are mean squares over the lines of G,
and their error the one of the mean over seeds; in brackets the largest one of a seed.

Then: how often a linear plant is called nonlinear at 5 % (400 seeds), the local
polynomial method on other records, the test for any input (300 seeds), and measured
records, where there are any (`ALSSNN_DATA_HOME`).  Without --quick the tables go to
doc/benchmarks/nonparametric.md.
"""

import argparse
import os
import sys
from pathlib import Path

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

import numpy as np
import scipy
from scipy.signal import butter, freqz, lfilter

import alssnn
from alssnn.datasets import fetch_silverbox
from alssnn.excitation import multisine, steps
from alssnn.first_look import nonlinearity
from alssnn.nonparametric import best_linear_approximation, local_polynomial
from benchmarks._tables import OUT, machine

PERIOD, RMS, NOISE = 4096, 0.5, 0.01
FIRST, SECOND = butter(2, 0.3), butter(2, 0.4)
DUFFING = {"dt": 0.4, "damping": 0.05, "cubic": 0.05, "steps": 4}
METHODS = {
    "robust": {"grid": "full", "n_realizations": 8},
    "fast": {"grid": "odd-random", "n_realizations": 1},
}
TRUTH = {"robust": 2000, "fast": 300}  # realizations


def _filter(system, u):
    return lfilter(*system, u, axis=-1)


def _curve(x):
    return x + 0.4 * x**2 - 0.3 * x**3


def duffing(u):
    """Return the position of an oscillator with a hardening spring, u held."""
    dt, n = DUFFING["dt"], DUFFING["steps"]
    h, x, v = dt / n, np.zeros(u.shape[:-1]), np.zeros(u.shape[:-1])
    y = np.empty_like(u)

    def rate(x, v, force):
        return v, force - 2 * DUFFING["damping"] * v - x - DUFFING["cubic"] * x**3

    for k in range(u.shape[-1]):
        y[..., k], force = x, u[..., k]
        for _ in range(n):
            a1, b1 = rate(x, v, force)
            a2, b2 = rate(x + h / 2 * a1, v + h / 2 * b1, force)
            a3, b3 = rate(x + h / 2 * a2, v + h / 2 * b2, force)
            a4, b4 = rate(x + h * a3, v + h * b3, force)
            x = x + h / 6 * (a1 + 2 * a2 + 2 * a3 + a4)
            v = v + h / 6 * (b1 + 2 * b2 + 2 * b3 + b4)
    return y


PLANTS = {
    "linear": lambda u: _filter(SECOND, _filter(FIRST, u)),
    "Wiener": lambda u: _curve(_filter(FIRST, u)),
    "Wiener, even": lambda u: (x := _filter(FIRST, u)) + 0.4 * x**2,
    "Wiener, odd": lambda u: (x := _filter(FIRST, u)) - 0.3 * x**3,
    "Hammerstein": lambda u: _filter(FIRST, _curve(u)),
    "Wiener-Hammerstein": lambda u: _filter(SECOND, _curve(_filter(FIRST, u))),
    "Duffing": duffing,
}


def excite(method, seed, n_realizations=None, n_periods=4):
    """Return a multisine and its inputs of equal rms, (realizations, N)."""
    options = dict(METHODS[method])
    options["n_realizations"] = n_realizations or options["n_realizations"]
    excitation = multisine(
        PERIOD, band=(0, 0.3), n_periods=n_periods, random_state=seed, **options
    )
    u = excitation.u.reshape(options["n_realizations"], -1)
    return excitation, u * (RMS / u.std())


def truth(plant, lines, n, seed):
    """Return G at `lines`, and the mean squares of distortions, (PERIOD // 2 + 1,)."""
    rng = np.random.default_rng(10_000 + seed)
    U = np.zeros((n, PERIOD // 2 + 1), dtype=complex)
    U[:, lines] = np.exp(2j * np.pi * rng.uniform(size=(n, len(lines))))
    u = np.fft.irfft(U, PERIOD)
    u = np.tile(u * (RMS / u.std()), 2)
    scale = np.sqrt(2) / PERIOD
    U, Y = (np.fft.rfft(z[:, PERIOD:]) * scale for z in (u, plant(u)))
    G = np.mean(Y[:, lines] * U[:, lines].conj(), axis=0)
    G /= np.mean(np.abs(U[:, lines]) ** 2, axis=0)
    Y[:, lines] -= G * U[:, lines]
    return G, np.mean(np.abs(Y) ** 2, axis=0)


def study(name, method, seeds):
    """Return a row: coverage of both bands, errors of levels, and separation."""
    plant, covered, levels = PLANTS[name], [], []
    made = [excite(method, seed) for seed in range(seeds)]
    clean = plant(np.concatenate([u for _, u in made]))
    outputs = np.split(clean, seeds)
    # a grid drawn at random has a truth of its own
    own = method == "fast"
    if not own:
        G, power = truth(plant, made[0][0].lines, TRUTH[method], 0)
    for seed, ((excitation, u), y) in enumerate(zip(made, outputs, strict=True)):
        rng = np.random.default_rng(seed)
        sigma = NOISE * y.std()
        noisy = y + sigma * rng.standard_normal(y.shape)
        bla = best_linear_approximation(
            u.reshape(-1, 1),
            noisy.ravel(),
            excitation.experiment,
            period=PERIOD,
            lines=excitation.lines,
        )
        lines = excitation.lines
        if own:
            G, power = truth(plant, lines, TRUTH[method], seed)
        if name == "linear":
            w = 2 * np.pi * bla.frequencies
            G = freqz(*FIRST, w)[1] * freqz(*SECOND, w)[1]
        low, high = bla.band()
        size = np.abs(G)[:, None, None]
        covered.append(
            [
                bla.covers(G[:, None, None]).mean(),
                ((low <= size) & (size <= high)).mean(),
            ]
        )
        band = np.arange(lines[0], lines[-1] + 1)
        even = band[band % 2 == 0]
        odd = np.setdiff1d(band, [*even, *lines])
        expected = [
            2 * sigma**2 / PERIOD,
            power[lines].mean(),
            power[even].mean() if own else np.nan,
            power[odd].mean() if own else np.nan,
        ]
        kinds = (bla.noise, bla.distortion, bla.even, bla.odd)
        found = [np.mean(level**2) for level in kinds]
        levels.append([found, expected])
    found, expected = np.moveaxis(np.array(levels), 1, 0)  # (seeds, 4)
    return np.mean(covered, axis=0), found, expected


def _decibels(x):
    with np.errstate(divide="ignore", invalid="ignore"):
        return 10 * np.log10(x)


def plants(seeds):
    """Return the lines of the table of plants."""
    rows = [
        "| plant | method | circles cover | bands cover | noise, dB | distortion, dB "
        "| even, dB | odd, dB | even over odd, dB | truth |",
        "|---|---|---|---|---|---|---|---|---|---|",
    ]
    for name in PLANTS:
        for method in METHODS:
            covered, found, expected = study(name, method, seeds)
            cells = [name, method, *(f"{100 * c:.1f} %" for c in covered)]
            sought = expected.mean(axis=0)
            for i in range(4):
                # less than a hundredth of the noise is none
                if not sought[i] > 0.01 * sought[0]:
                    cells.append("-")
                    continue
                mean = _decibels(found[:, i].mean() / sought[i])
                worst = np.abs(_decibels(found[:, i] / expected[:, i])).max()
                cells.append(f"{mean:+.2f} ({worst:.2f})")
            for pair in (found, expected):
                gap = _decibels(pair[:, 2].mean() / pair[:, 3].mean())
                cells.append(f"{gap:+.1f}" if abs(gap) < 200 else "-")
            if name == "linear":
                cells[-2:] = ["-", "-"]
            rows.append(f"| {' | '.join(cells)} |")
            print(rows[-1], flush=True)
    return rows


LINEAR = {
    "one input, 8 realizations": (1, {"n_realizations": 8}),
    "one input, 2 realizations": (1, {"n_realizations": 2}),
    "one input, odd random grid": (1, {"grid": "odd-random", "n_realizations": 1}),
    "2 x 2, 4 realizations": (2, {"n_realizations": 4}),
    "2 x 2, odd random grid": (2, {"grid": "odd-random", "n_realizations": 1}),
}


def linear(seeds):
    """Return the lines of the table of the test of linearity."""
    rows = ["| records | white noise | noise of a pole at 0.9 |", "|---|---|---|"]
    mix = np.array([[1.0, 0.5], [0.3, 1.0]])
    for name, (nu, options) in LINEAR.items():
        cells = [name]
        for pole in (0.0, 0.9):
            called = 0
            for seed in range(seeds):
                excitation = multisine(nu=nu, n_periods=4, random_state=seed, **options)
                rng = np.random.default_rng(seed)
                e = rng.standard_normal((len(excitation), nu))
                y = np.concatenate(
                    [_filter(FIRST, u.T).T for u in excitation.experiments]
                )
                y = y @ mix[:nu, :nu] + 0.05 * lfilter([1], [1, -pole], e, axis=0)
                called += best_linear_approximation(excitation, y).p_linear < 0.05
            cells.append(f"{100 * called / seeds:.1f} %")
        rows.append(f"| {' | '.join(cells)} |")
        print(rows[-1], flush=True)
    return rows


def local(seeds):
    """Return the lines of the table of the local polynomial method."""
    rows = [
        "| record, 2 inputs, 2 outputs | circles cover | noise level, dB |",
        "|---|---|---|",
    ]
    kinds = ("white noise", "steps", "two experiments", "gaps", "colored noise")
    for kind in kinds:
        covered, found = [], []
        for seed in range(seeds):
            rng = np.random.default_rng(seed)
            u = rng.standard_normal((4000, 2))
            if kind == "steps":
                u = steps(4000, 2, hold=(1, 20), random_state=seed).u
            e = 0.05 * rng.standard_normal((4000, 2))
            if kind == "colored noise":
                e = lfilter([1], [1, -0.9], e, axis=0)
            x1, x2 = _filter(FIRST, u[:, 0]), _filter(SECOND, u[:, 1])
            y = np.column_stack([x1 + 0.5 * x2, 2 * x2 - 0.3 * x1]) + e
            experiment = None
            if kind == "two experiments":
                experiment = np.repeat([0, 1], [2600, 1400])
            if kind == "gaps":
                y[1000:1100, 0], y[2500:2520], y[2600] = np.nan, np.nan, np.nan
            response = local_polynomial(u, y, experiment, n_frequencies=200)
            w = 2 * np.pi * response.frequencies
            g1, g2 = freqz(*FIRST, w)[1], freqz(*SECOND, w)[1]
            G = np.stack([[g1, 0.5 * g2], [-0.3 * g1, 2 * g2]]).transpose(2, 0, 1)
            covered.append(response.covers(G).mean())
            found.append(np.mean(response.total_rms**2) / np.mean(e**2))
        level = (
            f"{_decibels(np.mean(found)):+.2f} ({np.abs(_decibels(found)).max():.2f})"
        )
        rows.append(f"| {kind} | {100 * np.mean(covered):.1f} % | {level} |")
        print(rows[-1], flush=True)
    return rows


KINDS = {
    "white noise": {},
    "steps, noise of a pole at 0.9": {"hold": 8, "pole": 0.9},
    "2 x 2, noise of a pole at 0.9": {"nu": 2, "pole": 0.9},
    "2 x 2, noise of the process, gaps": {"nu": 2, "process": 0.5, "gaps": 5},
    "two experiments": {"parts": 2},
    "lightly damped": {"system": ([0, 0.1], [1, -1.9, 0.97])},
    "five sines": {"sines": 5},
}


def any_input(seeds):
    """Return the lines of the table of the test (eq. reset) for records of any kind."""
    rows = [
        "| record of 1,500 samples | linear | + 0.2 x² | + 0.2 x³ |",
        "|---|---|---|---|",
    ]
    for kind, options in KINDS.items():
        called = np.zeros(3)
        for seed in range(seeds):
            rng, nu = np.random.default_rng(seed), options.get("nu", 1)
            hold, pole = options.get("hold", 1), options.get("pole", 0.0)
            u = np.repeat(rng.standard_normal((1500 // hold + 1, nu)), hold, axis=0)[
                :1500
            ]
            if "sines" in options:
                f, phase = rng.uniform(
                    [[0.001], [0]], [[0.05], [1]], (2, options["sines"])
                )
                turns = f * np.arange(1500)[:, None] + phase
                u = np.sin(2 * np.pi * turns).sum(axis=1, keepdims=True)
            w = u + options.get("process", 0.0) * rng.standard_normal(u.shape)
            x = lfilter(*options.get("system", FIRST), w, axis=0)
            x *= 0.5 / x.std(axis=0)
            e = 0.1 * lfilter([1], [1, -pole], rng.standard_normal(x.shape), axis=0)
            mix = np.array([[1, 0.5], [0, 1]])[:nu, :nu]
            experiment = np.repeat(np.arange(options.get("parts", 1)), 1500)
            experiment = experiment[:: options.get("parts", 1)]
            for i, z in enumerate((x, x + 0.2 * x**2, x + 0.2 * x**3)):
                y = z @ mix + e * np.sqrt(1 - pole**2)
                y[rng.integers(1500, size=options.get("gaps", 0)), 0] = np.nan
                p, _ = nonlinearity(u, y, experiment)
                called[i] += p < 0.05
        cells = [f"{100 * share:.1f} %" for share in called / seeds]
        rows.append(f"| {kind} | {' | '.join(cells)} |")
        print(rows[-1], flush=True)
    return rows


def measured():
    """Return the lines of the table of measured records, and why some are missing."""
    rows = [
        "| record | method | output | no linear model below | no model below |",
        "|---|---|---|---|---|",
    ]

    def row(name, bla, unit):
        cells = [name, bla.method]
        for level in (bla.output_rms, bla.total_rms, bla.noise_rms):
            known = np.isfinite(level).all()
            cells.append(f"{np.mean(level):.3g} {unit}" if known else "not told apart")
        rows.append(f"| {' | '.join(cells)} |")
        print(rows[-1], flush=True)

    home = Path(os.environ.get("ALSSNN_DATA_HOME", "")) / "fine_steering_mirror"
    for level in (100, 200, 300):
        try:  # with both periods, which the loader joins
            u, y = (np.load(home / f"{z}_{level}mV_train.npy") for z in "uy")
        except FileNotFoundError as error:
            rows.append(f"| mirror, {level} mV | not measured: {error} | | | |")
            continue
        u, y = ([*np.moveaxis(z, (2, 3), (0, 1))] for z in (u, 1e6 * y))
        one = best_linear_approximation(
            [z.reshape(-1, 3) for z in u],
            [z.reshape(-1, 3) for z in y],
            dt=1 / 6400,
            period=8192,
            n_transient=0,
        )
        row(f"mirror, {level} mV", one, "µm")
    try:
        train, tests = fetch_silverbox()
        for name, record in {"train": train, **tests}.items():
            one = local_polynomial(record.u, 1e3 * record.y, dt=record.dt)
            row(f"Silverbox, {name}", one, "mV")
    except FileNotFoundError as error:
        rows.append(f"| Silverbox | not measured: {error} | | | |")
    return rows


def main(arguments=None):
    """Run, print and write."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--seeds", type=int, default=20)
    parser.add_argument("--quick", action="store_true", help="2 seeds, no file")
    options = parser.parse_args(arguments)
    load = os.getloadavg()[0]
    seeds = 2 if options.quick else options.seeds
    tables = {
        "Plants": plants(seeds),
        "Linear plants that are called nonlinear at 5 %": linear(20 * seeds),
        "Local polynomial method": local(seeds),
        "Records of any kind that are called nonlinear at 5 %": any_input(15 * seeds),
        "Measured records": measured(),
    }
    if options.quick:
        return 0
    text = [
        "# Best linear approximations",
        "",
        f"By `python -m benchmarks.nonparametric --seeds {seeds}`. Coverage of nominal",
        "95 %; errors of mean squares in dB, of the mean over seeds, and in brackets",
        "the largest one of a seed; a dash where there is nothing to find.",
        "",
    ]
    for title, rows in tables.items():
        text += [f"**{title}**", "", *rows, ""]
    text += [machine(load, alssnn, np, scipy), ""]
    (OUT / "nonparametric.md").write_text("\n".join(text), encoding="utf-8")
    return 0


if __name__ == "__main__":
    sys.exit(main())
