r"""
A quarter drone, identified in closed loop
==========================================

An arm carries one propeller at its end; gravity pulls it back,

.. math:: \ddot\theta = c_1 \sin\theta + c_2 u^2 + c_3 \dot\theta, \qquad y = \theta .

Gravity enters with the thrust and depends on the angle alone: a law :math:`h(y)` of the
output cancels it.  Thrust goes with the square of the command, which no such law
changes; but the square is known, so that the thrust is the better input.

The records are the measured ones where they are available, else a simulated pendulum.
"""

# %%
# The records
# -----------
# Two runs are fitted together, steps and multisine, and a third tests, a swept sine.
# Before the arm leaves its stop there is nothing to learn, and an arm that takes
# seconds does not need a sample every 0.01 s.

import warnings

import numpy as np
from sklearn.exceptions import ConvergenceWarning

from alssnn import AlSsnn, FlSsnn, GrSsnn, LinearStateSpace
from alssnn.datasets import fetch_quarter_drone, make_pendulum
from alssnn.metrics import rmse

warnings.simplefilter("ignore", ConvergenceWarning)  # fits are short on purpose here


def prepare(u, y):
    """Return thrust and angle, from lift-off on, every 0.05 s."""
    thrust = np.maximum(u, 0.0) ** 2 / 100  # the propeller turns one way
    return thrust[1_000::5], y[1_000::5]


try:
    runs = {name: prepare(*run) for name, run in fetch_quarter_drone().items()}
    commands = {name: (10 * np.sqrt(thrust), y) for name, (thrust, y) in runs.items()}
    unit = "deg"
except FileNotFoundError:
    names = ["steps", "multisine", "swept sine"]
    runs = {
        name: tuple(make_pendulum(2_000, noise=0.01, random_state=i))
        for i, name in enumerate(names)
    }
    commands, unit = None, "rad"
dt = 0.05
train, test = [runs["steps"], runs["multisine"]], runs["swept sine"]
u, y = zip(*train, strict=True)

# %%
# The ladder
# ----------
# Sizes and weights were chosen by fitting one training run and simulating the other.

common = {"nx": 3, "dt": dt}
net = {"alpha": 1e-3, "n_init": 1, "stability": None, "max_iter": 60}
net |= {"random_state": 0, **common}
h = {"n_h": 6, "gamma_h": 1e-3, "feedback": "output"}
models = {
    "LTI": LinearStateSpace(**common),
    "FL-SSNN": FlSsnn(**h, **net),
    "AL-SSNN": AlSsnn(n_g=4, penalty="output", **h, **net),
    "GR-SSNN": GrSsnn(n_f=6, **net),
}
print(f"RMSE, {unit}{'training':>13s}{'test':>8s}{'linearization error':>22s}")
simulated = {}
for name, model in models.items():
    model.fit(u, y)
    error = rmse(*model.simulate_test(u, y))
    y_test, simulated[name] = model.simulate_test(*test)
    e = 100 * model.linearizability(*test).linearization_error[0]
    print(f"{name:12s}{error:12.3g}{rmse(y_test, simulated[name]):8.3g}{e:20.1f} %")
if commands:
    raw = LinearStateSpace(**common)
    raw.fit(*zip(commands["steps"], commands["multisine"], strict=True))
    error = rmse(*raw.simulate_test(*commands["swept sine"]))
    print(f"LTI from the command itself {error:.3g}")

# %%
# The law
# -------
# What the law adds to the thrust undoes gravity, up to a straight line that the linear
# part keeps; below the simulations.

import matplotlib.pyplot as plt

_, (top, bottom) = plt.subplots(2, 1, figsize=(8, 6), layout="constrained")
t = dt * np.arange(len(y_test))
top.plot(t, y_test, "k", lw=2, label="measured")
for name, color in (("LTI", "0.6"), ("FL-SSNN", "C0"), ("AL-SSNN", "C3")):
    top.plot(t, simulated[name], color=color, label=name)
top.set(xlabel="time, s", ylabel=f"angle, {unit}", title="swept sine, free-run")
top.legend(ncols=4, fontsize="small")
angle = np.linspace(np.min(np.vstack(y)), np.max(np.vstack(y)), 200)[:, None]
for name in ("FL-SSNN", "AL-SSNN"):
    law = models[name].linearizing_law()
    v = np.full_like(angle, models[name].u_offset_[0])
    bottom.plot(angle, law(v, angle) - v, label=name)
bottom.set(
    xlabel=f"angle, {unit}", ylabel="u - v, units of u", title="what the law adds"
)
bottom.legend()
plt.show()
