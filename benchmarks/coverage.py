"""Confidence bands: how often do they cover the truth?

    python -m benchmarks.coverage [--seeds 200] [--samples 1000]
                                  [--noise {output,innovations}] [--nx 2]
    python -m benchmarks.coverage --networks [--seeds 10]

A linear plant of two states is identified from many records that differ in noise and
input.  Counted is how often the 95 % bands of the magnitude (at ten frequencies),
ellipses of the response in the complex plane and regions of the poles cover those of
the plant; how often the bands are wider by a bias; and how often the result says that
no band can (`holds`).  Both are right in a closed loop with noise that is correlated
over time.  Fits without bands do not count for the coverage.  With innovations, noise
of an order of its own needs states of its own: nx=3 for AR(.9).

With --networks, the linear part of a plant with a neuron is identified by FL-SSNN with
the defaults, in white noise.  Their decay holds it back; the second column leaves out
what the bands are wider by that (eq. pull).
"""

import argparse
import os
import warnings
from dataclasses import replace

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

import numpy as np
from scipy.stats import chi2

from alssnn import FlSsnn, LinearStateSpace

A = np.array([[1.6, -0.8], [1.0, 0.0]])
B = np.array([1.0, 0.0])
C = np.array([0.15, 0.1])
NEURON = np.array([0.3, -0.15])
OMEGA = np.geomspace(0.02, 3.0, 10)
# standard deviation and pole of the output noise; process noise at u; gain of -y to u
CASES = {
    "white": (0.2, 0.0, 0.0, 0.0),
    "AR(.9)": (0.2, 0.9, 0.0, 0.0),
    "process": (0.01, 0.0, 0.5, 0.0),
    "process, closed loop": (0.01, 0.0, 0.5, 0.4),
    "white, closed loop": (0.2, 0.0, 0.0, 0.4),
}


def make_record(case, n_samples, seed):
    """Return input and output of a noisy record.

    Parameters
    ----------
    case : str
        One of `CASES`.
    n_samples : int
        Number of samples.
    seed : int
        Of input and noise.

    Returns
    -------
    u, y : ndarray of shape (n_samples,)
        Record.
    """
    size, pole, process, gain = CASES[case]
    rng = np.random.default_rng(seed)
    reference = np.repeat(rng.uniform(-1.5, 1.5, n_samples // 4 + 1), 4)[:n_samples]
    white = size * np.sqrt(1 - pole**2) * rng.standard_normal(n_samples)
    w = process * rng.standard_normal(n_samples)
    x, v = np.zeros(2), size * rng.standard_normal()
    u, y = np.empty((2, n_samples))
    for k in range(n_samples):
        v = pole * v + white[k]
        y[k] = C @ x + v
        u[k] = reference[k] - gain * y[k]
        x = A @ x + B * (u[k] + w[k])
    return u, y


def make_bent(n_samples, seed):
    """Return a record of x+ = A x + B (u + 1.5 tanh(w x)) with 5 % white noise.

    Parameters
    ----------
    n_samples : int
        Number of samples.
    seed : int
        Of input and noise.

    Returns
    -------
    u, y : ndarray of shape (n_samples,)
        Record.
    """
    rng = np.random.default_rng(seed)
    u = np.repeat(rng.uniform(-1.5, 1.5, n_samples // 8 + 1), 8)[:n_samples]
    x, y = np.zeros(2), np.empty(n_samples)
    for k in range(n_samples):
        y[k] = C @ x
        x = A @ x + B * (u[k] + 1.5 * np.tanh(NEURON @ x))
    return u, y + 0.05 * y.std() * rng.standard_normal(n_samples)


def covered(covariance, level=0.95):
    """Return what the bands of a fit cover.

    Parameters
    ----------
    covariance : ParameterCovariance
        Uncertainty of a fit to a record of `make_record`.
    level : float, default=0.95
        Probability of the bands.

    Returns
    -------
    magnitude, ellipse : ndarray of bool of shape (n_frequencies,)
        Whether magnitude and response are covered.
    pole : bool
        Whether the pole is.
    """
    z = np.exp(1j * OMEGA)
    G = np.array([C @ np.linalg.solve(z_k * np.eye(2) - A, B) for z_k in z])
    band = covariance.frequency_response(OMEGA)
    low, high = (limit[:, 0, 0] for limit in band.magnitude_band(level))
    regions = covariance.poles()
    i = int(np.argmax(regions.poles.imag))
    pole = np.linalg.eigvals(A)
    error = pole[np.argmax(pole.imag)] - regions.poles[i]
    d = np.array([error.real, error.imag])
    distance = d @ np.linalg.pinv(regions.covariance[i], hermitian=True) @ d
    return (
        (low <= abs(G)) & (abs(G) <= high),
        band.covers(G[:, None, None], level)[:, 0, 0],
        bool(distance <= chi2.ppf(level, 2)),
    )


def of_networks(n_seeds, n_samples):
    """Print which magnitudes of the linear part of FL-SSNN are covered."""
    shares = []
    for seed in range(n_seeds):
        u, y = make_bent(n_samples, seed)
        options = {"feedback": "state", "operating_point": "zero"}
        model = FlSsnn(nx=2, n_h=1, random_state=seed, **options).fit(u, y)
        covariance = model.parameter_covariance(u, y)
        pulled = np.outer(covariance.pull, covariance.pull)
        alone = replace(covariance, covariance=covariance.covariance - pulled)
        shares.append([np.mean(covered(one)[0]) for one in (covariance, alone)])
        print(seed, "".join(f"{share:8.0%}" for share in shares[-1]), flush=True)
    print("mean", "".join(f"{share:8.1%}" for share in np.mean(shares, axis=0)))


def main():
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--seeds", type=int, default=200)
    parser.add_argument("--samples", type=int, default=1000)
    parser.add_argument("--noise", default="output", choices=["output", "innovations"])
    parser.add_argument("--nx", type=int, default=2)
    parser.add_argument("--networks", action="store_true", help="FlSsnn, see above")
    options = parser.parse_args()
    warnings.simplefilter("ignore", UserWarning)  # counted
    if options.networks:
        return of_networks(options.seeds, options.samples)
    print(f"{'noise':22s}{'|G|':>8s}{'G':>8s}{'poles':>8s}{'wider':>8s}{'says no':>9s}")
    for case in CASES:
        found, wider, refused = [], 0, 0
        for seed in range(options.seeds):
            u, y = make_record(case, options.samples, seed)
            model = LinearStateSpace(
                nx=options.nx, operating_point="zero", noise=options.noise
            ).fit(u, y)
            covariance = model.parameter_covariance(u, y)
            if not covariance.holds:
                refused += 1
                continue
            wider += bool(covariance.bias.any())
            found.append([np.mean(part) for part in covered(covariance)])
        shares = np.mean(found, axis=0) if found else np.full(3, np.nan)
        cells = "".join(f"{share:8.1%}" for share in shares)
        print(
            f"{case:22s}{cells}{wider / options.seeds:8.1%}"
            f"{refused / options.seeds:9.1%}",
            flush=True,
        )
    return None


if __name__ == "__main__":
    main()
