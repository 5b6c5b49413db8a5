r"""
One model for every sampling time
=================================

The Silverbox is an electronic Duffing oscillator, a mass on a spring that hardens.  Its
equations are those of physics, in continuous time, and its input was *measured* behind
an amplifier: between two samples it went on.  Both matter:

.. math:: x' = A x + B \bigl(u + h(y)\bigr), \qquad y = C x.

The record is the measured one where it is available, else a simulated oscillator.
"""

# %%
# The record
# ----------

import warnings

import matplotlib.pyplot as plt
import numpy as np
from sklearn.exceptions import ConvergenceWarning

from alssnn import FlSsnn
from alssnn.datasets import fetch_silverbox, make_duffing
from alssnn.metrics import rmse

warnings.simplefilter("ignore", ConvergenceWarning)  # fits are short on purpose here

try:
    train, tests = fetch_silverbox()
    train, test = train.split(6_000)[0], tests["arrow, no extrapolation"]
    holds, unit = ("zoh", "linear", "cubic"), "V"
except FileNotFoundError:
    train = make_duffing(2_000, noise=0.01, random_state=0)
    test = make_duffing(1_000, noise=0.01, random_state=1)
    holds, unit = ("zoh", "cubic"), "m"
print(train, test, sep="\n")

# %%
# What u does between the samples
# -------------------------------
# ``hold`` is a part of the model in continuous time.  A cubic spline is right for the
# measured input of the Silverbox.  The input of the simulated oscillator is held, and
# the spline is wrong there.

options = {"nx": 2, "n_h": 5, "feedback": "output", "odd": True, "random_state": 0}
models = {"discrete": FlSsnn(dt=train.dt, **options)}
for hold in holds:
    name = f"continuous, {hold}"
    models[name] = FlSsnn(dt=train.dt, time="continuous", hold=hold, **options)
errors = {}
for name, model in models.items():
    model.fit(train.u, train.y)
    y_true, y_pred = model.simulate_test(test.u, test.y)
    errors[name] = float(rmse(y_true, y_pred))
    share = 100 * errors[name] / np.std(y_true)
    print(f"{name:20} {errors[name]:.3g} {unit}, {share:.2g} % of the output")
best = min((name for name in models if name != "discrete"), key=errors.get)
model = models[best]

# %%
# The plant in units of physics
# -----------------------------
# A and B are per second.  The pair of poles is that of the linear part.  The figure
# below shows h without its straight line, which acts as a part of A: what is left
# hardens.

pole = np.linalg.eigvals(model.A_)[0]
print(f"{abs(pole) / (2 * np.pi):.3g} Hz, damping {-pole.real / abs(pole):.2g}")
y = np.linspace(*np.percentile(train.y, [0.1, 99.9]), 100)
h = model.plant_.cancelled(y[:, None])[:, 0]
bent = h - np.polyval(np.polyfit(y, h, 1), y)

# %%
# The law at another rate
# -----------------------
# A static law that is held for a sample acts late.  The same model, sampled at other
# times, says what that costs: how far its loop is from the linear one.


def left(plant, v):
    """Return the share of y that the loop of a law has beyond the linear one."""
    A, B, C, _ = plant.linear()
    x, x_lin, y, y_lin = np.zeros((1, plant.nx)), np.zeros(plant.nx), [], []
    for value in v:
        y.append(plant.output(x)[0, 0] - plant.y_offset[0])
        y_lin.append((C @ x_lin)[0])
        u = plant.law(value[None, None], plant.output(x))
        x, x_lin = plant.step(x, u), A @ x_lin + B @ (value[None] - plant.v_offset)
    return np.std(np.subtract(y, y_lin)) / np.std(y_lin)


parts = np.array([1, 2, 4, 8, 16])
rng = np.random.default_rng(0)
levels = np.std(train.u) * rng.standard_normal(40) + model.u_offset_[0]
rest = []
for part in parts:
    plant = model.plant_.at(train.dt / part)
    rest.append(left(plant, np.repeat(levels, 8 * part)))

fig, axes = plt.subplots(1, 2, figsize=(9, 3.4), layout="constrained")
axes[0].plot(y, bent)
axes[0].set(
    xlabel=f"y, {unit}", ylabel="h without its straight line", title="What is cancelled"
)
axes[1].loglog(train.dt / parts, 100 * np.array(rest), "o-")
axes[1].set(
    xlabel="sampling time of the law, s",
    ylabel="beyond the linear loop, % of y",
    title="What sampling costs",
)
axes[1].grid(True, which="both", alpha=0.3)
plt.show()

# sphinx_gallery_start_ignore
assert best == "continuous, cubic" if unit == "V" else best == "continuous, zoh"
assert errors[best] < errors["discrete"] or unit == "m"
assert all(np.diff(rest) < 0)
# sphinx_gallery_end_ignore
