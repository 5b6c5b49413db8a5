"""Draw doc/_static/idea.svg, the picture of the front page.

By ``python doc/idea.py``: a simulated pendulum in open loop, under a linear design, and
under the same design behind the identified law.
"""

from pathlib import Path

import control
import matplotlib.pyplot as plt
import numpy as np

from alssnn import FlSsnn, LinearStateSpace
from alssnn.datasets import make_pendulum
from alssnn.feedback import closed_loop, designed_loop, lqi

OUT = Path(__file__).parent / "_static" / "idea.svg"

record = make_pendulum(4_000, amplitude=5.0, noise=0.01, random_state=0)
options = {"nx": 2, "dt": record.dt, "operating_point": "zero"}
by_hand = {
    "alpha": 0.0,
    "n_init": 1,
    "stability": None,
    "tol": 1e-6,
    "coarse_samples": 15_000,
}
law = FlSsnn(
    n_h=8, feedback="state", gamma_h=1e-4, random_state=0, **by_hand, **options
)
models = {"linear design": LinearStateSpace(**options), "linearized loop": law}
r = np.repeat([0.0, 1.3, -1.0], [10, 80, 80])  # rad
t = record.dt * np.arange(len(r))

plt.rcParams.update({"svg.hashsalt": "alssnn", "path.simplify_threshold": 1.0})
_, axes = plt.subplots(1, 3, figsize=(9, 2.6), sharey=True, layout="constrained")
for ax, (name, model) in zip(axes[1:], models.items(), strict=True):
    model.fit(record.u, record.y)
    Q = np.zeros((3, 3))
    Q[:2, :2], Q[2, 2] = model.C_.T @ model.C_, 0.01
    K = lqi(model, Q, 1e-3 * np.eye(1))
    design = control.forced_response(designed_loop(model, K), t, r, squeeze=False)
    loop = closed_loop(record.plant, model, K)
    true = control.input_output_response(loop, t, r, squeeze=False).outputs[0]
    if ax is axes[1]:  # the input that the linear design plans, without feedback
        v = design.outputs[1]
        y = control.input_output_response(record.plant, t, v, squeeze=False).outputs[0]
        axes[0].plot(t, y, "0.5", lw=2)
        axes[0].plot(t, design.outputs[0], "k--", lw=1)
        axes[0].set(title="open loop", ylabel="angle, rad", ylim=(-2.5, 2.5))
    ax.plot(t, true, "C3" if ax is axes[1] else "C0", lw=2, label="true pendulum")
    ax.plot(t, design.outputs[0], "k--", lw=1, label="as designed")
    ax.set(title=name)
for ax in axes:
    ax.set(xlabel="time, s")
axes[2].legend(fontsize="small")
plt.savefig(OUT, metadata={"Date": None})
