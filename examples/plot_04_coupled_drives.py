r"""
A sensor that does not see the sign
===================================

A pulse counter measures how fast a shaft turns, but not in which direction.  No smooth
model bends as sharply as :math:`y = |s|`; a model of the signed signal :math:`s` need
not bend at all.  Here :math:`h` is *odd*: the plant treats both directions alike, as
friction does.  Two experiments are fitted together.

.. math:: x_{k+1} = A x_k + B (u_k + h(x_k)) + g(x_k, u_k), \qquad y_k = |C x_k|.

With the measured records of the coupled electric drives at hand, this page shows two
motors that drive a pulley by a flexible belt.  Without them it shows a simulated
pendulum that is mostly pushed one way, and whose angle lost its sign.  The first line
of output says which.
"""

# %%
# The records
# -----------
# A list has one record per experiment: the first part of each trains, the rest tests.

import warnings

import control
import numpy as np
from sklearn.exceptions import ConvergenceWarning

from alssnn import AlSsnn, FlSsnn, GrSsnn, LinearStateSpace
from alssnn.datasets import Record, fetch_coupled_drives, make_pendulum
from alssnn.metrics import rmse
from alssnn.rectified import restore_sign

warnings.simplefilter("ignore", ConvergenceWarning)  # fits are short on purpose here

try:
    train, test = fetch_coupled_drives()
    source, nx, quantity, unit = "measured drives", 4, "speed", "ticks/s"
except FileNotFoundError:
    runs = []
    for seed in (0, 1):
        run = make_pendulum(500, random_state=seed)
        u, t = run.u + 3.0, run.dt * np.arange(500)
        s = control.input_output_response(run.plant, t, u.T, X0=[0.0, 0.0]).outputs
        runs.append(Record(u, np.abs(s), run.dt, "|pendulum|"))
    train, test = zip(*(run.split(400) for run in runs), strict=True)
    source, nx, quantity, unit = "simulated pendulum", 2, "angle", "rad"
dt = train[0].dt
u, y = zip(*train, strict=True)
print(f"this page shows: {source}", *train, sep="\n")

# %%
# The sign
# --------
# A linear model tells the signs, the signs make a better linear model, and so on.  It
# is the first in the list below; the others are fitted to what it restored.

signed, linear = restore_sign(
    u, y, LinearStateSpace(nx=nx, operating_point="zero", dt=dt)
)
for i, s in enumerate(signed, start=1):
    print(f"experiment {i}, {quantity}: {100 * np.mean(s < 0):.0f} % of it is negative")

# %%
# The models
# ----------
# Sizes and weights were chosen on the last quarter of the training samples.

common = {"nx": nx, "operating_point": "zero", "dt": dt, "random_state": 0}
common |= {"max_iter": 200, "n_init": 1, "stability": None}
h = {"n_h": 4, "odd": True, "gamma_h": 1e-3, "feedback": "state", "alpha": 1e-4}
models = {
    "LTI": linear,
    "FL-SSNN": FlSsnn(**h, **common).fit(u, signed),
    "AL-SSNN": AlSsnn(n_g=4, penalty="output", **h, **common).fit(u, signed),
    "GR-SSNN": GrSsnn(n_f=5, alpha=1e-3, **common).fit(u, signed),
}

# %%
# Fresh data
# ----------
# Every test part continues its training part: the models are simulated from its first
# sample, so that they see no output of the test at all.

whole = [np.vstack([a.u, b.u]) for a, b in zip(train, test, strict=True)]
n = len(u[0])
y_hat = {
    name: [np.abs(s[n:]) for s in model.predict(whole, x0="training")]
    for name, model in models.items()
}
raw = LinearStateSpace(nx=nx, dt=dt).fit(u, y)
y_hat["LTI of |s|"] = [s[n:] for s in raw.predict(whole, x0="training")]
errors = {}
print(f"test RMSE, {unit}, of both experiments")
for name, parts in y_hat.items():
    errors[name] = [rmse(b.y, part) for b, part in zip(test, parts, strict=True)]
    print(f"{name:12s}", *(f"{error:8.3f}" for error in errors[name]))

# sphinx_gallery_start_ignore
assert (
    sum(errors["AL-SSNN"]) < 0.5 * sum(errors["LTI"]) < 0.5 * sum(errors["LTI of |s|"])
)
# sphinx_gallery_end_ignore

# %%
# How linear?
# -----------
# The law cancels h at the input.  What is left, g, produces this share of the signed
# output in the first experiment:

left = models["AL-SSNN"].linearizability(u[0], signed[0])
print(f"{100 * left.linearization_error[0]:.2g} % along the record")
print(f"{100 * left.closed_linearization_error[0]:.2g} % in the loop")

# %%
# Output and simulation
# ---------------------
# The sensor never shows a negative value: the curves touch zero and turn back.

import matplotlib.pyplot as plt

figure, axes = plt.subplots(2, 1, figsize=(8, 5), sharex=True, layout="constrained")
t = dt * np.arange(n, n + len(test[0]))
for i, axis in enumerate(axes):
    axis.plot(t, test[i].y, "k", lw=2, label=source)
    for name, color in (("LTI of |s|", "0.7"), ("LTI", "C3"), ("AL-SSNN", "C0")):
        axis.plot(t, y_hat[name][i], color=color, label=name)
    axis.set(ylabel=f"{quantity}, {unit}", title=f"experiment {i + 1}, test part")
axes[1].set(xlabel="time, s")
figure.legend(*axes[0].get_legend_handles_labels(), loc="outside upper center", ncols=4)
plt.show()
