r"""
Order, sizes and weight by grid search
======================================

How many states, how many neurons, what weight of the residual?  A model is a
scikit-learn estimator, so that its searches answer.  Three things are particular to
records of dynamical systems:

- folds are *blocks of time*, `BlockedTimeSeriesSplit`, never shuffled samples;
- accuracy is that of the free-run simulation, and it is not all that counts: the second
  score is the *linearization error*, what :math:`g` adds to the output;
- the choice is therefore constrained: the most accurate candidate among those that are
  linear enough.

The record is the measured Wiener-Hammerstein circuit where it is available, else a
simulated one.
"""

# %%
# The record
# ----------

import warnings

import numpy as np
from sklearn.exceptions import ConvergenceWarning
from sklearn.model_selection import GridSearchCV

from alssnn import AlSsnn, LinearStateSpace, scorers
from alssnn.datasets import fetch_wiener_hammerstein, make_wiener_hammerstein
from alssnn.model_selection import BlockedTimeSeriesSplit

warnings.simplefilter("ignore", ConvergenceWarning)  # fits are short on purpose here
# linear models of a nonlinear circuit: no band holds, see the end
warnings.filterwarnings("ignore", "No confidence band holds")

try:
    record, _ = fetch_wiener_hammerstein()
    u, y = record.u[20_000:24_000], record.y[20_000:24_000]
except FileNotFoundError:
    record = make_wiener_hammerstein(4_000, noise=0.001, random_state=0)
    u, y = record
print(record.name)

# %%
# The order first
# ---------------
# Linear models are quick, and the order of the linear part is most of the answer.  The
# criteria of Akaike and Bayes price every effective parameter.

print("nx     AIC       BIC     parameters")
for nx in (2, 4, 6, 8):
    linear = LinearStateSpace(nx=nx, dt=record.dt).fit(u, y)
    n = linear.parameter_covariance(u, y).n_effective
    print(f"{nx}{linear.aic(u, y):10.0f}{linear.bic(u, y):10.0f}{n:10.1f}")

# %%
# Criteria take the residuals for noise.  Here they are mostly the nonlinearity, so that
# the criteria can only suggest an order.  What decides is a simulation of samples that
# training did not see.
#
# The grid
# --------
# Two scores in one search.  `refit` takes a callable that chooses by both.

search = GridSearchCV(
    AlSsnn(alpha=0.0, n_init=1, dt=record.dt, max_iter=12, random_state=0),
    {"nx": [4, 6], "n_h": [0, 5], "n_g": [5], "gamma": [1.0, 0.1, 0.01]},
    cv=BlockedTimeSeriesSplit(2, gap=50),
    scoring={
        "accuracy": scorers.neg_rmse,
        "linearity": scorers.neg_linearization_error,
    },
    refit=scorers.best_subject_to(linearization_error=0.2),
)
search.fit(u, y)
results = search.cv_results_
rmse = -1e3 * results["mean_test_accuracy"]
error = -100 * results["mean_test_linearity"]
for i in np.argsort(rmse):
    p = results["params"][i]
    mark = "  <- chosen" if i == search.best_index_ else ""
    print(
        f"nx={p['nx']} n_h={p['n_h']} gamma={p['gamma']:<5g}"
        f"RMSE {rmse[i]:7.2f} mV   e/y {error[i]:5.1f} %{mark}"
    )

# %%
# Accuracy against linearity
# --------------------------
# Every candidate is a point, mean over the folds; the bound is the dashed line.  The
# fits of a grid start from scratch.  Along a path of falling weights each can start
# from the last, which is quicker and ends in better optima:
# `alssnn.model_selection.gamma_path`.

import matplotlib.pyplot as plt

_, axes = plt.subplots(figsize=(7, 4), layout="constrained")
orders = results["param_nx"].astype(int)
for nx in np.unique(orders):
    axes.plot(error[orders == nx], rmse[orders == nx], "o", label=f"{nx} states")
axes.plot(
    error[search.best_index_],
    rmse[search.best_index_],
    "o",
    ms=14,
    mfc="none",
    mec="k",
    label="chosen",
)
axes.axvline(20, color="0.5", ls="--")
axes.set(
    xlabel="linearization error, %",
    ylabel="test RMSE, mV",
    yscale="log",
    title="Candidates of the grid",
)
axes.yaxis.set_minor_formatter("{x:g}")
axes.yaxis.set_major_formatter("{x:g}")
axes.legend()
plt.show()

# %%
# How sure is the linear part?
# ----------------------------
# The frequency response does not depend on the state basis, so it has a standard error.
# Here the residuals are nonlinearity rather than noise, which the covariance notices:
# it refuses a confidence band.  What noise alone does is a lower bound.

linear = LinearStateSpace(nx=6, dt=record.dt).fit(u, y)
covariance = linear.parameter_covariance(u, y)
print("a band holds:", covariance.holds)
print(covariance.reason)

# sphinx_gallery_start_ignore
assert not covariance.holds
assert error[search.best_index_] <= 20
# sphinx_gallery_end_ignore
band = covariance.frequency_response()
size, spread = np.abs(band.response), 2 * band.magnitude_std
low, high = np.maximum(size - spread, 0), size + spread
_, axes = plt.subplots(figsize=(7, 3.5), layout="constrained")
hertz = band.omega / (2 * np.pi)
axes.fill_between(
    hertz, low[:, 0, 0], high[:, 0, 0], alpha=0.4, label="two standard errors"
)
axes.loglog(hertz, np.abs(band.response[:, 0, 0]), label="linear model, 6 states")
axes.set(xlabel="frequency, Hz", ylabel="magnitude", title="Linear part of the circuit")
axes.legend()
plt.show()
