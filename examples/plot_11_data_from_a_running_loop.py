"""
Data from a running loop
========================

An inverted pendulum is recorded in the loop that keeps it upright, with noise on sensor
and torque. No simulation can follow such a record: its errors grow with the plant. With
``noise="innovations"`` a model is fitted by its errors one sample ahead, and its gain K
holds the estimate of the states near the truth.
"""

import control
import matplotlib.pyplot as plt
import numpy as np

from alssnn import FlSsnn
from alssnn.datasets import make_inverted_pendulum
from alssnn.feedback import closed_loop, lqi

record = make_inverted_pendulum(4_000, angle=0.8, random_state=0)
model = FlSsnn(
    nx=2,
    n_h=6,
    feedback="output",
    gamma_h=1e-4,
    dt=record.dt,
    noise="innovations",
    n_init=1,
    random_state=0,
).fit(record.u, record.y)

# %%
# The law u = v - h(y) is that of the physics: h is the moment of gravity, but for a
# linear part that belongs to A (``gamma_h`` leaves it there).

y = np.linspace(-1, 1, 101)
h = model.plant_.cancelled(y[:, None])[:, 0]
truth = 4.0 * np.sin(y)  # (a / c) sin y, in Nm
_, ax = plt.subplots(figsize=(6, 4), layout="constrained")
for values, label, style in ((h, "identified", "-"), (truth, "physics", "--")):
    line = np.polyfit(y, values, 1)
    ax.plot(y, values - np.polyval(line, y), style, label=label)
ax.set(xlabel="angle, rad", ylabel="h without its linear part, Nm")
_ = ax.legend()

# sphinx_gallery_start_ignore
bent = [z - np.polyval(np.polyfit(y, z, 1), y) for z in (h, truth)]
assert np.abs(bent[0] - bent[1]).max() < 0.3 * np.ptp(bent[1])
# sphinx_gallery_end_ignore

# %%
# The same model makes predictions, observer and loop. Here the true plant starts to
# fall from half a radian, and the observer knows nothing of it.

K = lqi(model, np.eye(3), 0.01 * np.eye(1))
loop = closed_loop(record.plant, model, K, law=model.linearizing_law(-20, 20))
t = record.dt * np.arange(100)
x0 = np.zeros(loop.nstates)
x0[next(i for i, name in enumerate(loop.state_labels) if "angle" in name)] = 0.5
response = control.input_output_response(loop, t, np.zeros(100), x0)
_, ax = plt.subplots(figsize=(6, 4), layout="constrained")
ax.plot(t, response.outputs[0])
ax.set(xlabel="time, s", ylabel="angle, rad", title="The true pendulum is caught")
plt.show()

# sphinx_gallery_start_ignore
assert np.abs(response.outputs[0]).max() < 1.0
assert abs(response.outputs[0, -1]) < 0.01
# sphinx_gallery_end_ignore
