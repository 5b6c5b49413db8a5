r"""
A law of the output that cancels gravity
========================================

An arm carries one propeller at its end, a quarter of a drone; gravity pulls it back,

.. math:: \ddot\theta = c_1 \sin\theta + c_2 u^2 + c_3 \dot\theta, \qquad y = \theta .

Gravity enters with the thrust and depends on the angle alone: a law :math:`h(y)` of the
output cancels it.  Thrust goes with the square of the command, which no such law
changes; but the square is known, so that the thrust is the better input.

With the measured records at hand, this page shows that arm.  Without them it shows a
simulated pendulum, which gravity pulls back as well, and whose torque is the input.
The first line of output says which.
"""

# %%
# The records
# -----------
# Two runs are fitted together, and a third one tests.  Of the measured arm these are
# steps, a multisine and a swept sine.  Before it leaves its stop there is nothing to
# learn, and an arm that takes seconds does not need a sample every 0.01 s.

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
    source, unit = "measured arm", "deg"
except FileNotFoundError:
    names = ["steps", "multisine", "swept sine"]
    runs = {
        name: tuple(make_pendulum(2_000, noise=0.01, random_state=i))
        for i, name in enumerate(names)
    }
    commands, source, unit = None, "simulated pendulum", "rad"
dt = 0.05
train, test = [runs["steps"], runs["multisine"]], runs["swept sine"]
u, y = zip(*train, strict=True)
print(f"this page shows: {source}")

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
    share = f"{e:.1f} %" if np.isfinite(e) else "A is unstable"
    print(f"{name:12s}{error:12.3g}{rmse(y_test, simulated[name]):8.3g}{share:>22s}")
if commands:
    raw = LinearStateSpace(**common)
    raw.fit(*zip(commands["steps"], commands["multisine"], strict=True))
    error = rmse(*raw.simulate_test(*commands["swept sine"]))
    print(f"LTI from the command itself {error:.3g}")

# %%
# The law
# -------
# Above the output, and what two models miss of it.  Below what the law of FL-SSNN adds
# to the input: it undoes gravity, up to a straight line that the linear part keeps.

import matplotlib.pyplot as plt

_, axes = plt.subplots(3, 1, figsize=(8, 8), layout="constrained")
t = dt * np.arange(len(y_test))
axes[0].plot(t, y_test, "k")
axes[0].set(xlabel="time, s", ylabel=f"angle, {unit}", title=f"{source}, test run")
for name, color in (("LTI", "0.6"), ("FL-SSNN", "C0")):
    axes[1].plot(t, y_test - simulated[name], color=color, label=name)
axes[1].set(xlabel="time, s", ylabel=f"{unit}", title="output minus simulation")
axes[1].legend(ncols=2, fontsize="small")
angle = np.linspace(np.min(np.vstack(y)), np.max(np.vstack(y)), 200)[:, None]
model = models["FL-SSNN"]
v = np.full_like(angle, model.u_offset_[0])
added = model.linearizing_law()(v, angle) - v
axes[2].plot(angle, added, "C0")
axes[2].set(
    xlabel=f"angle, {unit}", ylabel="u - v, units of u", title="what the law adds"
)
plt.show()

# sphinx_gallery_start_ignore
error = {name: rmse(y_test, values) for name, values in simulated.items()}
assert error["FL-SSNN"] < 0.8 * error["LTI"]
assert np.ptp(added) > 0.1 * np.std(np.vstack(u))
# sphinx_gallery_end_ignore
