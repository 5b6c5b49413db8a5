"""Certificates that hold are checked in exact arithmetic, of the very floats."""

from fractions import Fraction
from itertools import product

import numpy as np
import pytest

from alssnn.certificates import gain_certificate, iss_certificate
from alssnn.lure import Lure

CASES = 100


def exact(X):
    """Return an array of the rational numbers that floats are."""
    return np.array([Fraction(float(x)) for x in np.ravel(X)], dtype=object).reshape(
        np.shape(X)
    )


def is_positive(X):
    """Tell whether a symmetric rational matrix is positive definite, by LDL'."""
    X = X.copy()
    assert (X == X.T).all()
    for k in range(len(X)):
        if not X[k, k] > 0:
            return False
        for i in range(k + 1, len(X)):
            X[i, k + 1 :] = X[i, k + 1 :] - X[i, k] / X[k, k] * X[k, k + 1 :]
    return True


def iss_form(c):
    """Return minus the inequality (eq. lmi)."""
    A, P, phi, psi = exact(c.A), exact(c.P), Fraction(c.phi), Fraction(c.psi)
    n, one = len(A), exact(np.eye(len(A)))
    form = np.empty((2 * n, 2 * n), dtype=object)
    form[:n, :n] = (1 - phi) * P - A.T @ P @ A
    form[:n, n:], form[n:, :n] = -A.T @ P, -P @ A
    form[n:, n:] = psi * one - P
    return form, P


def gain_form(c):
    """Return minus the inequality (eq. slopes), written down once more."""
    lure, P, Lam = c.lure, exact(c.P), exact(c.Lam)
    nx, nu, nw = lure.nx, lure.nu, lure.nw
    Theta = exact(lure.Theta[:, :-1])
    plus, y, v = Theta[:nx], Theta[nx : nx + lure.nz], Theta[nx + lure.nz :]
    one = exact(np.eye(nx + nu + nw))
    now, u, w = one[:nx], one[nx : nx + nu], one[nx + nu :]
    sector = w.T @ (Lam[:, None] * (v - w)) if nw else 0 * one
    decay, gamma = Fraction(c.decay), Fraction(c.gamma)
    form = decay**2 * (now.T @ P @ now) - plus.T @ P @ plus - y.T @ y
    return form + gamma**2 * (u.T @ u) - sector - sector.T, P


def random_lure(rng):
    nx, nu, ny = rng.integers(1, 4, 3)
    nw = rng.integers(0, 4)
    Theta = rng.choice([0.2, 0.4]) * rng.standard_normal(
        (nx + ny + nw, nx + nu + nw + 1)
    )
    A = rng.standard_normal((nx, nx))
    Theta[:nx, :nx] = A * rng.uniform(0.1, 0.99) / np.abs(np.linalg.eigvals(A)).max()
    Theta[nx + ny :, nx + nu : -1] = np.tril(Theta[nx + ny :, nx + nu : -1], -1)
    return Lure(Theta, nx, nu, nw)


def iss(rng):
    A = rng.standard_normal((3, 3))[: (n := rng.integers(1, 4)), :n]
    A *= rng.uniform(0.05, 1.001) / np.abs(np.linalg.eigvals(A)).max()
    return iss_certificate(A, objective=rng.choice(["peak", "volume", "feasible"]))


def gain(rng):
    lure, decay = random_lure(rng), float(rng.choice([1.0, 0.95]))
    c = gain_certificate(lure, decay=decay)
    if c.lure.nw == lure.nw:
        np.testing.assert_array_equal(c.lure.Theta, lure.Theta)
    return c


KINDS = {"iss": (iss, iss_form), "gain": (gain, gain_form)}


@pytest.mark.parametrize("kind", KINDS)
def test_what_holds_is_true(kind):
    make, form_of = KINDS[kind]
    held = 0
    for seed in range(CASES):
        c = make(np.random.default_rng(seed))
        if c.holds:
            held += 1
            form, P = form_of(c)
            assert is_positive(P) and is_positive(form), seed
            if kind == "gain":
                assert (c.Lam >= 0).all()
    assert held > CASES / 2


@pytest.mark.parametrize("kind", KINDS)
def test_the_check_can_fail(kind):
    """The same certificates, with numbers that claim a hundredth more."""
    make, form_of = KINDS[kind]
    for seed in range(20):
        c = make(np.random.default_rng(seed))
        if not c.holds:
            continue
        claim = {"iss": ("psi", 0.99), "gain": ("gamma", 0.99)}[kind]
        object.__setattr__(c, claim[0], claim[1] * getattr(c, claim[0]))
        assert c.verify() <= 0
        assert not is_positive(form_of(c)[0])


def test_ldl_is_exact():
    tiny = Fraction(1, 10**30)
    for a, b in product((-1, 0, 1), repeat=2):
        X = np.array([[1 + 0 * tiny, 1], [1, 1 + a * tiny]], dtype=object)
        assert is_positive(X) == (a > 0)
        assert is_positive(np.array([[b * tiny]], dtype=object)) == (b > 0)
