r"""
Drives whose speed lost its sign
================================

Two motors drive a pulley by a flexible belt; a pulse counter measures the speed of the
pulley, but not its sign.  Two experiments are fitted together.  No smooth model bends
as sharply as :math:`y = |s|`; the model of the signed speed :math:`s` need not bend at
all, and an *odd* :math:`h` is what friction calls for:

.. math:: x_{k+1} = A x_k + B (u_k + h(x_k)) + g(x_k, u_k), \qquad y_k = |C x_k|.

The records are the measured ones where they are available, else a simulated pendulum
that is mostly pushed one way and whose angle lost its sign.
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
    nx, quantity, unit = 4, "speed", "ticks/s"
except FileNotFoundError:
    runs = []
    for seed in (0, 1):
        run = make_pendulum(500, random_state=seed)
        u, t = run.u + 3.0, run.dt * np.arange(500)
        s = control.input_output_response(run.plant, t, u.T, X0=[0.0, 0.0]).outputs
        runs.append(Record(u, np.abs(s), run.dt, "|pendulum|"))
    train, test = zip(*(run.split(400) for run in runs), strict=True)
    nx, quantity, unit = 2, "angle", "rad"
dt = train[0].dt
u, y = zip(*train, strict=True)
print(*train, sep="\n")

# %%
# The sign
# --------
# A linear model of the speed tells the signs, the signs make a better linear model, and
# so on.  It is the first in the list below; the others are fitted to what it restored.

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
print(f"test RMSE, {unit}")
for name, parts in y_hat.items():
    errors = [rmse(b.y, part) for b, part in zip(test, parts, strict=True)]
    print(f"{name:12s}", *(f"{error:8.3f}" for error in errors))

# %%
# How linear?
# -----------
# The odd h takes the friction to the input, where a law cancels it.  What is left, g,
# produces this share of the speed:

print(models["AL-SSNN"].linearizability(u, signed))

# %%
# Measured and simulated
# ----------------------

import matplotlib.pyplot as plt

_, axes = plt.subplots(2, 1, figsize=(8, 5), sharex=True, layout="constrained")
t = dt * np.arange(n, n + len(test[0]))
for i, axis in enumerate(axes):
    axis.plot(t, test[i].y, "k", lw=2, label="measured")
    for name, color in (("LTI of |s|", "0.7"), ("LTI", "C3"), ("AL-SSNN", "C0")):
        axis.plot(t, y_hat[name][i], color=color, label=name)
    axis.set(ylabel=f"{quantity}, {unit}", title=f"experiment {i + 1}, test part")
axes[1].set(xlabel="time, s")
axes[0].legend(ncols=4, fontsize="small")
plt.show()
