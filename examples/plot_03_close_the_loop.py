r"""
Close the loop
==============

A pendulum is identified from a noisy record; a linear controller is designed on the
linear part of the model; the *true* pendulum is run with it.  Does the response come
out that was designed?  With a linear model it does not: far from rest gravity pulls
less than the model believes.  With the law :math:`u = v - h(\hat x)` it does.

.. math:: \ddot\theta = -g_0 \sin\theta - d\,\dot\theta + \tau
"""

# %%
# From a record to a closed loop
# ------------------------------
# The regulator has an integrator, so that the angle settles at its reference.  The
# observer, the model run beside the plant, gives :math:`\hat x` from the measured
# angle.  h alone is the torque of gravity, and the fit finds that g is not needed.

import control
import numpy as np

from alssnn import AlSsnn, LinearStateSpace
from alssnn.datasets import make_pendulum
from alssnn.feedback import closed_loop, designed_loop, lqi

record = make_pendulum(2_000, amplitude=5.0, noise=0.01, random_state=0)
options = {"nx": 2, "dt": record.dt, "operating_point": "zero"}
model = AlSsnn(random_state=0, **options).fit(record.u, record.y)
print(model.message_)
Q = np.zeros((3, 3))  # of the states and the integrator
Q[:2, :2], Q[2, 2] = model.C_.T @ model.C_, 0.01
K = lqi(model, Q, 1e-3 * np.eye(1))
loop = closed_loop(record.plant, model, K)  # plant, law, observer and controller
print(f"{loop.nstates} states, from {loop.input_labels} to {loop.output_labels}")

# %%
# The same on a linear model
# --------------------------
# Same record, same weights; there is no law.

linear = LinearStateSpace(**options).fit(record.u, record.y)


def respond(model, r):
    """Return the designed response, the true one, and the input v of the design."""
    Q = np.zeros((3, 3))
    Q[:2, :2], Q[2, 2] = model.C_.T @ model.C_, 0.01
    K = lqi(model, Q, 1e-3 * np.eye(1))
    t = record.dt * np.arange(len(r))
    design = control.forced_response(designed_loop(model, K), t, r, squeeze=False)
    loop = closed_loop(record.plant, model, K)
    true = control.input_output_response(loop, t, r, squeeze=False)
    return design.outputs[0], true.outputs[0], design.outputs[1]


r = np.repeat([0.0, 0.4, 1.3, -1.0, 0.0], [10, 80, 80, 80, 80])  # rad
responses = {"linear model": respond(linear, r), "with the law": respond(model, r)}
missed = {}
for name, (design, true, _) in responses.items():
    missed[name] = 1e3 * np.sqrt(np.mean((true - design) ** 2))
    print(f"{name:14s} RMS distance from its design {missed[name]:7.2f} mrad")

# sphinx_gallery_start_ignore
assert missed["with the law"] < 0.05 * missed["linear model"]
# sphinx_gallery_end_ignore

# %%
# What can be certified
# ---------------------
# Where g is zero, the law leaves nothing of the model: its loop is linear for all
# states and inputs.  The incremental gain from v to the angle holds everywhere, too.
# Neither knows how far the plant is from the model: that is what the distances say.

print(model.iss_certificate(record.u, record.y))
gain = model.gain_certificate()
print(gain)
print(model.linearizability(record.u, record.y))

# sphinx_gallery_start_ignore
assert gain.holds
# sphinx_gallery_end_ignore

# %%
# Open loop, linear design, linearized loop
# -----------------------------------------
# Without feedback, the input of the linear design carries the arm over the top, where
# the axes end.  With feedback the arm arrives, but not as designed.  With the law the
# two curves lie on each other: the lower axes show how far apart they are.

import matplotlib.pyplot as plt

t = record.dt * np.arange(len(r))
v = responses["linear model"][2]
y_open = control.input_output_response(record.plant, t, v, squeeze=False).outputs[0]
_, axes = plt.subplots(2, 1, figsize=(7, 5.5), sharex=True, layout="constrained")
axes[0].plot(t, y_open, color="0.75", label="open loop, input of the linear design")
for (name, (design, true, _)), color in zip(
    responses.items(), ("C3", "C0"), strict=True
):
    axes[0].plot(t, true, color=color, label=f"true loop, {name}")
    axes[0].plot(t, design, "k--", lw=0.8)
    axes[1].semilogy(t, np.abs(true - design) + 1e-9, color=color)
axes[0].plot([], [], "k--", lw=0.8, label="the two designs")
axes[0].set(ylabel="angle, rad", title="The true pendulum in closed loop", ylim=(-3, 3))
axes[0].annotate(
    "open loop goes on", (5.8, 2.9), (2.2, 2.3), arrowprops={"arrowstyle": "->"}
)
axes[0].legend(fontsize="small", loc="lower left")
axes[1].set(xlabel="time, s", ylabel="distance from design, rad", ylim=(1e-6, 1))
plt.show()
