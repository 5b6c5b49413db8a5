r"""
Records as they come: gaps, delays, several experiments
=======================================================

A measured record is rarely one long table of numbers.  Here the pendulum was recorded
in three experiments of different lengths, the command reaches the motor four samples
late, and a sensor lost a fifth of its samples.  None of it needs preparation.
"""

# %%
# Three experiments
# -----------------
# Each is an array of its own: a list of them is one data set.  An output that was not
# measured is nan; an input has to be known.

import numpy as np

from alssnn import FlSsnn, LinearStateSpace
from alssnn.datasets import make_pendulum
from alssnn.metrics import rmse

LATE = 4  # samples
rng = np.random.default_rng(0)


def spoil(record):
    """Return command and output of a record: late, with gaps."""
    command = np.vstack([record.u[LATE:], np.zeros((LATE, 1))])
    y = record.y.copy()
    y[rng.random(len(y)) < 0.2] = np.nan
    y[300:340] = np.nan  # and a cable was loose
    return command, y


records = [
    make_pendulum(n, noise=0.01, random_state=seed)
    for seed, n in enumerate([1_500, 900, 600])
]
u, y = zip(*(spoil(record) for record in records), strict=True)
u, y = list(u), list(y)
print("not measured:", [f"{np.isnan(y_i).mean():.0%}" for y_i in y])

# %%
# The delay
# ---------
# ``input_delay="auto"`` takes the largest delay that costs neither prediction nor
# simulation of a linear model, over all experiments, gaps or not.  The plant answers
# slowly and through noise, so the sure way is to fit the model itself with the delays
# around it: every sample too few or too many costs accuracy.  The experiments have
# their own initial states, and nothing is simulated across a seam.

options = {"nx": 2, "dt": records[0].dt, "operating_point": "zero"}
auto = LinearStateSpace(input_delay="auto", **options).fit(u, y)
print(f"linear models say {auto.input_delay_[0]} samples")
models = {
    delay: FlSsnn(
        n_h=6,
        gamma_h=1e-4,
        alpha=0.0,  # costs are compared: the same decay for all
        n_init=1,
        input_delay=delay,
        random_state=0,
        **options,
    ).fit(u, y)
    for delay in range(2, 7)
}
for delay, model in models.items():
    print(f"delay {delay}: cost {model.cost_:.2e}")
delay = min(models, key=lambda delay: models[delay].cost_)
model = models[delay]
print(f"the fits say {delay}; initial states: {model.x0_.shape}")

# %%
# Labels
# ------
# Labels do the same as a list, and survive scikit-learn's slicing:

from alssnn import stack_experiments

u_all, y_all, experiment = stack_experiments(u, y)
print(f"R2, all three experiments: {model.score(u_all, y_all, experiment):.4f}")

# %%
# What the sensor did not see
# ---------------------------
# The truth is known here.  A simulation needs no measured output, so it fills the gaps;
# its error there is of the same size as elsewhere.

y_hat = model.predict(u, x0="training")
true = [make_pendulum(len(r.u), random_state=i).y for i, r in enumerate(records)]
gaps = [np.isnan(y_i) for y_i in y]
errors = []
for where in ("measured", "missing"):
    of = [gap if where == "missing" else ~gap for gap in gaps]
    pairs = [
        np.concatenate([z[i] for z, i in zip(signal, of, strict=True)])
        for signal in (true, y_hat)
    ]
    errors.append(1e3 * np.mean(rmse(*pairs)))
    print(f"{where}: RMSE {errors[-1]:.2f} mrad")

# sphinx_gallery_start_ignore
assert delay == LATE and errors[1] < 2 * errors[0]
# sphinx_gallery_end_ignore

# %%
import matplotlib.pyplot as plt

_, ax = plt.subplots(figsize=(7, 3), layout="constrained")
t = records[0].dt * np.arange(250, 400)
ax.plot(t, true[0][250:400], "0.7", lw=4, label="truth")
ax.plot(t, y[0][250:400], "k.", ms=4, label="measured")
ax.plot(t, y_hat[0][250:400], "C0", label="simulated")
ax.set(xlabel="time, s", ylabel="angle, rad", title="A loose cable")
ax.legend(ncols=3, fontsize="small")
plt.show()
