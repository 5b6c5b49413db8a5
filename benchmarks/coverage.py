"""Confidence bands: how often do they cover the truth?

    python -m benchmarks.coverage [--seeds 200] [--samples 1000]
                                  [--noise {output,innovations}] [--nx 2]

A linear plant of two states is identified from many records that differ in noise and
input.  Counted is how often the 95 % bands of the magnitude (at ten frequencies),
ellipses of the response in the complex plane and regions of the poles cover those of
the plant; how often the bands are wider by a bias; and how often the result says that
no band can (`holds`).  Both are right in a closed loop with noise that is correlated
over time.  Fits without bands do not count for the coverage.  With innovations, noise
of an order of its own needs states of its own: nx=3 for AR(.9).
"""

import argparse
import os
import warnings

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

import numpy as np
from scipy.stats import chi2

from alssnn import LinearStateSpace

A = np.array([[1.6, -0.8], [1.0, 0.0]])
B = np.array([1.0, 0.0])
C = np.array([0.15, 0.1])
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


def main():
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--seeds", type=int, default=200)
    parser.add_argument("--samples", type=int, default=1000)
    parser.add_argument("--noise", default="output", choices=["output", "innovations"])
    parser.add_argument("--nx", type=int, default=2)
    options = parser.parse_args()
    warnings.simplefilter("ignore", UserWarning)  # counted
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


if __name__ == "__main__":
    main()
