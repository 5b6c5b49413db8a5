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
fig, (left, right) = plt.subplots(1, 2, figsize=(10, 4), layout="constrained")
for values, label, style in ((h, "identified", "-"), (truth, "physics", "--")):
    line = np.polyfit(y, values, 1)
    left.plot(y, values - np.polyval(line, y), style, label=label)
left.set(xlabel="angle [rad]", ylabel="h without its linear part [Nm]")
left.legend()

# %%
# The same model makes predictions, observer and loop. Here the true plant starts to
# fall from half a radian, and the observer knows nothing of it.

K = lqi(model, np.eye(3), 0.01 * np.eye(1))
loop = closed_loop(record.plant, model, K, law=model.linearizing_law(-20, 20))
t = record.dt * np.arange(100)
x0 = np.zeros(loop.nstates)
x0[next(i for i, name in enumerate(loop.state_labels) if "angle" in name)] = 0.5
response = control.input_output_response(loop, t, np.zeros(100), x0)
right.plot(t, response.outputs[0])
right.set(xlabel="time [s]", ylabel="angle [rad]", title="true plant, caught")
plt.show()
