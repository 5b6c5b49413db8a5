r"""
Predictive control within limits
================================

The motor of a pendulum is too weak to hold the arm level, and its angle should not
pass a bound.  A linear regulator knows neither; a predictive controller plans with
both.  Because the law :math:`u = v - h(\hat x)` leaves a linear model, the plan is a
convex quadratic program at every sample (:eq:`mpc`), though the plant is not.
"""

# %%
# The model
# ---------
# Identified from a noisy record, with state feedback; a linear model beside it.

import numpy as np

from alssnn import FlSsnn, LinearStateSpace
from alssnn.datasets import make_pendulum

record = make_pendulum(3_000, amplitude=5.0, noise=0.01, random_state=0)
options = {"nx": 2, "dt": record.dt, "operating_point": "zero"}
model = FlSsnn(n_h=6, gamma_h=1e-4, random_state=0, **options)
model.fit(record.u, record.y)
linear = LinearStateSpace(**options).fit(record.u, record.y)

# %%
# The loop on the true pendulum
# -----------------------------
# The torque is limited to 8 (gravity takes up to 9.81) and changes by at most 2 per
# sample; 1 rad is a soft bound of the angle, and the last reference lies beyond both.
# An estimated constant disturbance removes the offset that a model error would leave:
# a linear model with the same limits arrives, too.  But what it plans is not what
# comes, not even one sample later, and it passes the bound.

limits = {"u_min": -8, "u_max": 8, "du_max": 2, "y_max": 1.0}
reference = np.repeat([0.0, 0.8, -0.9, 1.2], [10, 70, 70, 70])[:, None]  # rad
loops = {}
for name, fitted in (("linear model", linear), ("linearized", model)):
    mpc = fitted.mpc(horizon=20, **limits)
    loops[name] = mpc.simulate(record.plant, reference)
    loop = loops[name]
    error = 1e3 * np.sqrt(np.mean((loop.y_plan[:-1, 0] - loop.y[1:]) ** 2))
    excess = 1e3 * (loop.y.max() - 1)
    print(f"{name:13s} RMS error of plans {error:6.2f} mrad, excess {excess:5.1f} mrad")
print(loops["linearized"])

# sphinx_gallery_start_ignore
assert loops["linear model"].y.max() > 1.01 > 1.002 > loops["linearized"].y.max()
assert np.abs(loops["linearized"].u).max() <= 8
# sphinx_gallery_end_ignore

# %%
# Angle and torque
# ----------------
# The last reference is out of reach, which is not an error.  The controller finds the
# nearest state of rest that the limits allow: here the motor just balances gravity.

import matplotlib.pyplot as plt

target = reference[-1, 0] + loops["linearized"].target_error[-1, 0]
print(f"target {target:.4f} rad; the true balance is at {np.arcsin(8 / 9.81):.4f} rad")
_, (top, bottom) = plt.subplots(2, 1, figsize=(7, 5), sharex=True, layout="constrained")
top.plot(loops["linearized"].t, reference, "k--", lw=0.8, label="reference")
top.axhline(1.0, color="0.6", lw=0.8, label="bound")
for (name, loop), color in zip(loops.items(), ("C3", "C0"), strict=True):
    top.plot(loop.t, loop.y, color=color, label=name)
    bottom.step(loop.t, loop.u, color=color, where="post")
for limit in (-8, 8):
    bottom.axhline(limit, color="0.6", lw=0.8)
top.set(ylabel="angle, rad", title="The true pendulum under predictive control")
top.legend(fontsize="small", ncols=4, loc="lower left", bbox_to_anchor=(0, 1.08))
bottom.set(xlabel="time, s", ylabel="torque, rad/s²")
plt.show()
