from dataclasses import replace
from functools import partial

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.optimize import brentq, least_squares

from alssnn import adjoint, compression
from alssnn.compression import EIGENVALUE_FLOOR, compress
from alssnn.criterion import DIVERGED_NORM, Criterion, Restricted
from alssnn.limits import Limits
from alssnn.models import state_space
from alssnn.scaling import Scaling
from alssnn.sensitivities import sensitivities
from alssnn.simulation import outputs, simulate
from helpers import assert_jacobian, dense_jacobian, dense_residuals, random_theta


@pytest.fixture
def criterion(structure, experiments):
    return Criterion(structure, experiments, weights=weights(structure), alpha=0.01)


def weights(structure):
    """Return a weight for each channel of a structure."""
    every = {"y": 1.0, "g": 0.7, "e": 0.7, "k": 0.2, "h": 0.4, "v": 0.3}
    return {channel: every[channel] for channel in structure.channels}


@pytest.fixture
def free(criterion, rng):
    theta = random_theta(criterion.structure, rng)
    return criterion.join(theta, rng.standard_normal((2, criterion.structure.n_x0)))


def test_cost_is_the_paper_s(rng):
    structure = state_space(2, 1, 1, n_h=2, n_g=3, C=np.ones((1, 2))).observe(
        "y", "g", "h"
    )
    theta, x0 = random_theta(structure, rng), rng.standard_normal((1, 2))
    u, y = rng.standard_normal((15, 1)), rng.standard_normal((15, 1))
    p, x, cost = structure.split(theta), x0[0], 0.0
    for k in range(15):
        y_hat = structure.constants["C"] @ x
        pre = p["W_x"] @ x + p["W_u"] @ u[k] + p["b_x"]
        g = p["W_g"] @ (np.tanh(pre) - np.tanh(p["b_x"]))
        h = p["W_h"] @ np.tanh(p["W_y"] @ y_hat + p["b_y"]) + p["b_h"]
        cost += np.sum((y[k] - y_hat) ** 2) + 0.3 * np.sum(g**2)
        cost += 0.05 * np.sum(h**2)
        x = p["A"] @ x + p["B"] @ (u[k] + h) + g
    net = sum(np.sum(p[k] ** 2) for k in structure.network_parameters)
    assert set(structure.network_parameters) == set(p) - {"A", "B"}
    weights = {"y": 1.0, "g": 0.3, "h": 0.05}
    criterion = Criterion(structure, [(u, y)], weights=weights, alpha=0.02)
    got = criterion.norm(criterion.join(theta, x0)) ** 2
    np.testing.assert_allclose(got, cost / 15 + 0.02 * net)


@pytest.mark.parametrize(
    ("weights", "got"),
    [(None, "y"), ({"y": 1.0}, "y"), ({"y": 1.0, "v": 1.0, "g": 1.0}, "y, v, g")],
)
def test_every_channel_has_a_weight(weights, got, rng):
    structure = state_space(2, 1, 1, n_g=2, C=np.ones((1, 2))).observe("y", "v")
    pair = rng.standard_normal((9, 1)), rng.standard_normal((9, 1))
    with pytest.raises(ValueError, match=f"one for each .* y, v, got {got}. "):
        Criterion(structure, [pair], weights=weights)


def test_jacobian(criterion, free):
    assert_jacobian(
        partial(dense_residuals, criterion), dense_jacobian(criterion, free), free
    )


def test_normal_equations_equal_the_dense_ones(criterion, free):
    r, J = dense_residuals(criterion, free), dense_jacobian(criterion, free)
    JJ, Jr, norm = criterion.normal_equations(free)
    np.testing.assert_allclose(JJ, J.T @ J, atol=1e-13)
    np.testing.assert_allclose(Jr, J.T @ r, atol=1e-13)
    np.testing.assert_allclose(norm, np.linalg.norm(r))


@pytest.mark.parametrize("span", [None, 11])
def test_what_is_pulled_equals_the_dense_one(criterion, free, rng, monkeypatch, span):
    if span is not None:  # shorter than a record, whose states are then repeated
        kept = span * 16 * criterion.structure.nx
        monkeypatch.setattr(adjoint, "KEPT_BYTES", kept)
        monkeypatch.setattr(adjoint, "GAINS_BYTES", 1)
    step = 0.05 * rng.standard_normal(len(free))
    r = [dense_residuals(criterion, point) for point in (free, free + step)]
    expected = dense_jacobian(criterion, free).T @ (r[1] - r[0])
    got = criterion.pulled(free, free + step)
    np.testing.assert_allclose(got, expected, rtol=1e-9, atol=1e-12)


def test_compression_is_exact(criterion, free):
    JJ, Jr, norm = criterion.normal_equations(free)
    fun, jac = criterion.fun(free), criterion.jac(free)
    assert fun.shape == (criterion.n + 1,)
    assert jac.shape == (criterion.n + 1, criterion.n)
    assert np.linalg.norm(fun) == pytest.approx(norm, rel=1e-13)
    np.testing.assert_allclose(jac.T @ fun, Jr, atol=1e-14)
    np.testing.assert_allclose(jac.T @ jac, JJ, atol=1e-12)


def test_compression_against_householder(rng):
    """TSQR twin: QR of [J r], then a reflection of the last column onto e_1."""
    J, r = rng.standard_normal((50, 6)), rng.standard_normal(50)
    R = np.linalg.qr(np.column_stack([J, r]), mode="r")
    v = R[:, -1].copy()
    v[0] += np.copysign(np.linalg.norm(v), v[0])
    H = np.eye(7) - 2 * np.outer(v, v) / (v @ v)
    reflected = H @ R
    sign = np.sign(reflected[0, -1])
    ours = compress(J.T @ J, J.T @ r, np.linalg.norm(r))
    np.testing.assert_allclose(reflected[1:, -1], 0, atol=1e-13)
    np.testing.assert_allclose(ours[0], sign * reflected[0, :-1], atol=1e-12)
    np.testing.assert_allclose(
        ours[1:].T @ ours[1:], reflected[1:, :-1].T @ reflected[1:, :-1], atol=1e-12
    )


def test_compression_keeps_parameters_without_effect_still(rng):
    J = rng.standard_normal((20, 4))
    J[:, 2] = 0.0
    r = rng.standard_normal(20)
    jac = compress(J.T @ J, J.T @ r, np.linalg.norm(r))
    assert not np.any(jac[:, 2])


@pytest.mark.parametrize("rank", [1, 5, 29])
def test_compression_needs_no_eigenvectors_for_a_free_basis(monkeypatch, rng, rank):
    """Directions without effect are raised to the level of rounding, and no further."""
    basis = rng.standard_normal((rank, 30)) * 10.0 ** rng.uniform(-6, 6, 30)
    J, r = rng.standard_normal((500, rank)) @ basis, rng.standard_normal(500)
    monkeypatch.setattr(compression, "eigh", None)
    jac = compress(J.T @ J, J.T @ r, np.linalg.norm(r))
    size = np.linalg.norm(J, axis=0)
    error = (jac.T @ jac - J.T @ J) / np.outer(size, size)
    assert np.abs(error).max() < 30 * EIGENVALUE_FLOOR
    assert np.linalg.svd(jac / size)[1][-1] > np.sqrt(EIGENVALUE_FLOOR) / 2


def test_compression_of_a_residual_along_the_only_column_is_finite(rng):
    """All of J'J is in a'a then, and what is left is rounding of either sign."""
    for size in 10.0 ** rng.uniform(-9, 9, 50):
        J = size * rng.standard_normal((40, 1))
        r = rng.standard_normal() * J[:, 0]
        jac = compress(J.T @ J, J.T @ r, np.linalg.norm(r))
        np.testing.assert_allclose(jac.T @ jac, J.T @ J, rtol=1e-12)


def test_gaps_count_for_outputs_alone(rng):
    """Errors are averaged over what was measured, penalties over all samples."""
    structure = state_space(2, 1, 1, n_g=3, C=np.ones((1, 2))).observe("y", "g")
    theta, x0 = random_theta(structure, rng), np.zeros((1, 2))
    u, y = rng.standard_normal((80, 1)), rng.standard_normal((80, 1))
    y[20:70] = np.nan
    z = outputs(structure.lure(theta), u, x0[0])
    weights = {"y": 1.0, "g": 0.5}
    criterion = Criterion(structure, [(u, y)], weights=weights)
    cost = np.nanmean((z[:, :1] - y) ** 2) + 0.5 * np.sum(z[:, 1:] ** 2) / 80
    assert criterion.norm(criterion.join(theta, x0)) ** 2 == pytest.approx(cost)


def test_a_decay_pulls_networks_to_their_center(rng):
    structure = state_space(2, 1, 1, n_g=3, C=np.ones((1, 2)))
    theta, center = random_theta(structure, rng), random_theta(structure, rng)
    x0, record = np.zeros((1, 2)), [tuple(rng.standard_normal((2, 50, 1)))]
    plain = Criterion(structure, record)
    pulled = Criterion(structure, record, alpha=0.3, center=center)
    free, is_net = plain.join(theta, x0), np.zeros(len(theta), dtype=bool)
    for name in structure.network_parameters:
        is_net[structure.slices[name]] = True
    away = 0.3 * np.sum((theta - center)[is_net] ** 2)
    assert pulled.norm(free) ** 2 == pytest.approx(plain.norm(free) ** 2 + away)
    assert pulled.normal_equations(free)[2] == pytest.approx(pulled.norm(free))


def test_compression_of_a_perfect_fit_is_finite():
    assert np.isfinite(compress(np.eye(3), np.zeros(3), 0.0)).all()


@pytest.mark.parametrize("method", ["lm", "trf"])
def test_least_squares_takes_the_same_steps_compressed_and_dense(method, rng):
    # a scalar state leaves no freedom of basis: J has full rank and rounding is all
    # that can tell the two apart
    structure = state_space(1, 1, 1, n_h=2, n_g=1, C=np.ones((1, 1))).observe("y", "g")
    truth = random_theta(structure, rng)
    u = rng.standard_normal((300, 1))
    y = simulate(structure.lure(truth), u, np.zeros(1))[:-1]
    y = y + 0.1 * rng.standard_normal(y.shape)
    criterion = Criterion(structure, [(u, y)], weights={"y": 1.0, "g": 0.5}, alpha=1e-3)
    start = criterion.join(truth + 0.2 * rng.standard_normal(len(truth)), np.zeros(1))
    visited = {}
    for name, fun, jac in [
        ("compressed", criterion.fun, criterion.jac),
        (
            "dense",
            partial(dense_residuals, criterion),
            partial(dense_jacobian, criterion),
        ),
    ]:
        points = visited[name] = []
        least_squares(
            fun,
            start,
            jac=lambda x, jac=jac, points=points: points.append(x.copy()) or jac(x),
            method=method,
            x_scale="jac",
            max_nfev=10,
        )
    assert len(visited["dense"]) >= 5
    np.testing.assert_allclose(visited["compressed"], visited["dense"], atol=1e-9)


def test_gamma_zero_and_no_penalty_agree(rng):
    options = {"n_h": 2, "n_g": 2, "C": np.ones((1, 2))}
    u, y = rng.standard_normal((30, 1)), rng.standard_normal((30, 1))
    norms = []
    for channels in ("yg", "ye", "y"):
        structure = state_space(2, 1, 1, **options).observe(*channels)
        theta = random_theta(structure, np.random.default_rng(1))
        criterion = Criterion(
            structure, [(u, y)], weights={"y": 1.0, **dict.fromkeys(channels[1:], 0.0)}
        )
        norms.append(criterion.norm(criterion.join(theta, np.zeros((1, 2)))))
    np.testing.assert_allclose(norms, norms[0], rtol=1e-14)


def test_chunk_size_changes_nothing(structure, experiments, free):
    results = [
        Criterion(
            structure, experiments, weights=weights(structure), alpha=0.01, chunk=chunk
        ).normal_equations(free)
        for chunk in (None, 3)
    ]
    for whole, chunked in zip(*results, strict=True):
        np.testing.assert_allclose(whole, chunked, rtol=1e-12, atol=1e-13)


@pytest.mark.parametrize("making", [0.1, 100.0])  # some squares are its own, or none
def test_a_second_thread_changes_no_digit(
    structure, experiments, rng, monkeypatch, making
):
    monkeypatch.setattr("alssnn.contribution.MAKING", making)
    theta, x0 = random_theta(structure, rng), np.zeros((1, structure.n_x0))
    one, two = (
        Criterion(
            structure,
            experiments[1:],
            weights=weights(structure),
            chunk=3,
            n_jobs=n_jobs,
        )
        for n_jobs in (None, 2)
    )
    assert two.one.pipelined
    assert (two.one._own_squares(two.n) > 2) == (making < 1)
    free = one.join(theta, x0)
    for a, b in zip(
        one.normal_equations(free), two.normal_equations(free), strict=True
    ):
        np.testing.assert_array_equal(a, b)


def test_splitting_a_record_at_its_true_state_keeps_the_cost(structure, rng):
    if "zeta" in structure.states:
        pytest.skip("zeta starts at zero in every experiment: e is a property of it")
    theta = random_theta(structure, rng)
    u = rng.standard_normal((40, structure.nu))
    y = rng.standard_normal((40, structure.sizes["y"]))
    X = simulate(structure.lure(theta), u, np.zeros(structure.nx))
    records = [(u, y)], [(u[:25], y[:25]), (u[25:], y[25:])]
    whole, parts = (
        Criterion(structure, record, weights=weights(structure)) for record in records
    )
    n_x0 = structure.n_x0
    assert parts.norm(parts.join(theta, X[[0, 25], :n_x0])) == pytest.approx(
        whole.norm(whole.join(theta, X[[0], :n_x0])), rel=1e-12
    )


def test_memo_is_not_stale(criterion, free):
    first = criterion.norm(free)
    other = free + 0.1
    criterion.norm(other)
    assert criterion.norm(free) == first
    free[0] += 0.1  # the caller may change its array in place
    assert criterion.norm(free) != first


def test_divergence_is_a_large_finite_norm(rng):
    structure = state_space(1, 1, 1)
    criterion = Criterion(structure, [(np.ones((3000, 1)), np.ones((3000, 1)))])
    free = criterion.join(
        structure.join({"A": [[3.0]], "B": [[1.0]]}), np.zeros((1, 1))
    )
    assert criterion.norm(free) == DIVERGED_NORM
    assert np.isfinite(criterion.fun(free)).all()
    with pytest.raises(FloatingPointError, match="diverges at these parameters"):
        criterion.normal_equations(free)


@pytest.mark.parametrize(
    ("activation", "gain", "x0"),
    [("tanh", 1.5, 0.0), ("tanh", 1e200, 0.0), ("sin", 4.0, 1.0)],
    ids=["balanced", "overflow within a chunk", "chaotic"],
)
@pytest.mark.parametrize("n_jobs", [None, 2])
def test_diverging_sensitivities_of_a_bounded_simulation(activation, gain, x0, n_jobs):
    """x+ = gain sigma(x): bounded, while dx/dx0 grows like gain^k."""
    structure = state_space(1, 1, 1, n_g=1, C=np.ones((1, 1)), activation=activation)
    theta = structure.join({"W_g": [[gain]], "W_x": [[1.0]]})
    record = np.zeros((3000, 1)), np.ones((3000, 1))
    criterion = Criterion(structure, [record], n_jobs=n_jobs)
    free = criterion.join(theta, [[x0]])
    assert criterion.norm(free) < 10
    for derivative in (criterion.normal_equations, criterion.jac):
        with pytest.raises(FloatingPointError, match="sensitivities diverge"):
            derivative(free)


@pytest.mark.parametrize("N", [1, 9, 1025])
def test_a_state_lost_at_the_last_sample_is_a_divergence(N):
    """To the norm as to the derivatives, wherever chunks end."""
    structure = state_space(1, 1, 1, C=np.ones((1, 1)))
    u = np.zeros((N, 1))
    u[-1] = 1e9
    criterion = Criterion(structure, [(u, np.zeros((N, 1)))])
    free = criterion.join(structure.join({"A": [[0.5]], "B": [[1.0]]}), [[0.0]])
    assert criterion.norm(free) == DIVERGED_NORM
    with pytest.raises(FloatingPointError, match="diverges at these parameters"):
        criterion.normal_equations(free)


@pytest.mark.parametrize("n_jobs", [None, 2])
@pytest.mark.parametrize(("square", "is_refused"), [(0.5e32, False), (1.5e32, True)])
def test_where_a_mean_square_derivative_leads_nowhere(square, is_refused, n_jobs):
    """x+ = a x from zero: y = 0, dy_k/dx0 = a^k, whose mean square is given."""
    N, k = 50, np.arange(50)
    a = brentq(lambda a: np.log(np.mean(a ** (2.0 * k)) / square), 1.5, 4.0)
    structure = state_space(1, 1, 1, C=np.ones((1, 1)))
    record = np.zeros((N, 1)), np.zeros((N, 1))
    criterion = Criterion(structure, [record], n_jobs=n_jobs, chunk=7)
    free = criterion.join(structure.join({"A": [[a]]}), [[0.0]])
    if is_refused:
        with pytest.raises(FloatingPointError, match="sensitivities diverge"):
            criterion.normal_equations(free)
    else:
        JJ, _, norm = criterion.normal_equations(free)
        assert norm == 0 and JJ[-1, -1] == pytest.approx(square)


def test_what_the_cost_does_not_see_is_raised_to_rounding(rng):
    """A direction without effect keeps 1e-12 of the largest eigenvalue."""
    one = rng.standard_normal(30)
    J = np.column_stack([one, one])  # equilibrated: eigenvalues 2 and 0
    L_t = compress(J.T @ J, np.zeros(2), 1.0)[1:] / np.linalg.norm(one)
    eigenvalues = np.linalg.eigvalsh(L_t.T @ L_t)
    assert eigenvalues[1] == pytest.approx(2)
    assert np.linalg.norm(L_t @ [1, -1]) ** 2 / 2 == pytest.approx(2e-12, rel=1e-3)


def test_restricted_is_a_part_of_the_whole(criterion, free, rng):
    mask = rng.random(criterion.n) > 0.5
    part = Restricted(criterion, free, mask)
    np.testing.assert_array_equal(part.to_free(free[mask]), free)
    JJ, Jr, norm = criterion.normal_equations(free)
    JJ_p, Jr_p, norm_p = part.normal_equations(free[mask])
    np.testing.assert_array_equal(JJ_p, JJ[np.ix_(mask, mask)])
    np.testing.assert_array_equal(Jr_p, Jr[mask])
    assert norm_p == norm == pytest.approx(part.fun(free[mask])[0], rel=1e-13)


@pytest.fixture
def columns(monkeypatch):
    """The numbers of columns of all J that are made."""
    seen = []

    def watched(*args, **options):
        for part, Z, J in sensitivities(*args, **options):
            seen.append(J.shape[2])
            yield part, Z, J

    monkeypatch.setattr("alssnn.contribution.sensitivities", watched)
    return seen


@pytest.mark.parametrize("periodic", [False, True])
def test_what_is_held_takes_no_derivatives(
    structure, experiments, rng, periodic, columns
):
    options = {"weights": weights(structure), "alpha": 0.01, "periodic": periodic}
    criterion = Criterion(structure, experiments, **options)
    x0 = rng.standard_normal((len(experiments), structure.n_x0))
    free = criterion.join(0.7 * random_theta(structure, rng), x0)
    held = rng.random(structure.n_params) < 0.5
    names = structure.network_parameters
    for name in names[:1]:  # a whole network parameter, too
        held[structure.slices[name]] = True
    JJ, Jr, norm = criterion.normal_equations(free)
    columns.clear()
    found = criterion.holding(held)
    assert criterion.one.free is None  # it is another one
    JJ_h, Jr_h, norm_h = found.normal_equations(free)
    assert set(columns) == {np.sum(~held) + structure.n_x0 + 1}
    kept = np.append(~held, np.ones(x0.size, dtype=bool))
    decay, both = np.diag(criterion.decay**2), np.outer(kept, kept)
    size = max(1.0, np.abs(JJ).max())
    np.testing.assert_allclose(JJ_h, np.where(both, JJ, decay), atol=1e-12 * size)
    expected = np.where(kept, Jr, criterion.decay**2 * free)
    np.testing.assert_allclose(Jr_h, expected, atol=1e-12 * size)
    assert norm_h == pytest.approx(norm, rel=1e-13)
    assert criterion.holding(np.zeros_like(held)) is criterion


@pytest.mark.filterwarnings("error")
def test_all_is_held(structure, experiments, rng):
    """With a given initial state, nothing is differentiated then."""
    known = replace(structure, free_starts=0)
    criterion = Criterion(known, experiments, weights=weights(known))
    held = np.ones(known.n_params, dtype=bool)
    free = criterion.join(random_theta(known, rng), np.zeros((len(experiments), 0)))
    JJ, Jr, norm = criterion.holding(held).normal_equations(free)
    assert not JJ.any() and not Jr.any()
    assert norm == pytest.approx(criterion.norm(free))


def test_a_search_differentiates_by_what_is_free(columns, rng):
    structure = state_space(3, 1, 1)
    A = np.diag([0.9, 0.5, -0.3])
    theta = structure.join({"A": A, "B": np.ones((3, 1)), "C": np.ones((1, 3))})
    u = rng.standard_normal((60, 1))
    y = outputs(structure.lure(theta), u, np.zeros(3))
    diagonal = np.where(np.eye(3, dtype=bool), np.inf, 0.0)
    limits = Limits(structure, bounds={"A": (-diagonal, diagonal)}, at_rest=True)
    criterion = Criterion(structure, [(u, y)])
    start = criterion.join(theta * rng.uniform(0.9, 1.1, len(theta)), np.zeros((1, 3)))
    result = limits.minimize(criterion, start, tol=1e-14)
    assert result.cost < 1e-20 and set(columns) == {9 + 3 + 1}
    A_ = structure.split(result.x[:15])["A"]
    np.testing.assert_allclose(A_, A, atol=1e-9)


# -- random structures -----------------------------------------------------------------

sizes = st.one_of(
    st.integers(0, 3), st.lists(st.integers(1, 3), min_size=1, max_size=3).map(tuple)
)
names = st.sampled_from(["tanh", "sigmoid", "identity", "sin"])


@st.composite
def structures(draw):
    """Return any member of the model class, of any size."""
    nx, nu, ny = (draw(st.integers(1, 3)) for _ in "xuy")
    odd = draw(st.booleans())
    structure = state_space(
        nx,
        nu,
        ny,
        n_h=draw(sizes),
        n_g=draw(sizes),
        n_k=draw(sizes),
        C=np.random.default_rng(draw(st.integers(0, 9))).standard_normal((ny, nx)),
        feedthrough=draw(st.booleans()),
        feedback=draw(st.sampled_from(["output", "state"])),
        tied_bias=draw(st.booleans()),
        odd=odd,
        activation={
            "h": "sin" if odd else draw(names),
            "g": draw(names),
            "k": draw(names),
        },
    )
    penalties = sorted(set(structure.signals) - {"y"})
    return structure.observe(
        "y", *draw(st.lists(st.sampled_from(penalties), unique=True))
    )


@settings(max_examples=25, deadline=None, derandomize=True)
@given(
    structure=structures(),
    seed=st.integers(0, 2**16),
    lengths=st.lists(st.integers(2, 12), min_size=1, max_size=3),
    missing=st.sampled_from([0.0, 0.3]),
    max_delay=st.integers(0, 3),
    chunk=st.sampled_from([None, 1, 5]),
)
def test_gradient_of_any_model(structure, seed, lengths, missing, max_delay, chunk):
    """All options at once: J of the residuals, and the sums made of it."""
    rng = np.random.default_rng(seed)
    nu, ny = structure.nu, structure.sizes["y"]
    scaling = Scaling(*(rng.uniform(0.5, 2, n) for n in (nu, ny, nu, ny)))
    delay = rng.integers(0, max_delay + 1, nu)
    experiments = []
    for n in lengths:
        u, y = rng.standard_normal((n, nu)), rng.standard_normal((n, ny))
        y[rng.random(y.shape) < missing] = np.nan
        experiments.append((scaling.scale_u(u, delay), scaling.scale_y(y)))
    criterion = Criterion(
        structure,
        experiments,
        weights={**weights(structure), "y": rng.uniform(0, 2, ny)},
        alpha=0.01,
        chunk=chunk,
    )
    x0 = rng.standard_normal((len(lengths), structure.n_x0))
    free = criterion.join(random_theta(structure, rng, radius=0.5), x0)
    r, J = dense_residuals(criterion, free), dense_jacobian(criterion, free)
    assert np.isfinite(r).all()
    assert_jacobian(partial(dense_residuals, criterion), J, free, rtol=1e-10)
    JJ, Jr, norm = criterion.normal_equations(free)
    size = max(1.0, np.abs(JJ).max())
    np.testing.assert_allclose(JJ, J.T @ J, atol=1e-11 * size)
    np.testing.assert_allclose(Jr, J.T @ r, atol=1e-11 * size)
    assert criterion.norm(free) == pytest.approx(norm, rel=1e-12)
