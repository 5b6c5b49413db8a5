r"""
A first model
=============

From a record of input and output to a model made for control.  The plant is a simulated
Wiener-Hammerstein circuit: a filter, a diode-like saturation, another filter.

.. math:: x_{k+1} = A x_k + B (u_k + h(x_k)) + g(x_k, u_k), \qquad y_k = C x_k
"""

# %%
# The record
# ----------
# A record has its input, output and sampling time; the first half trains.

import numpy as np

from alssnn import AlSsnn
from alssnn.datasets import make_wiener_hammerstein

record = make_wiener_hammerstein(3_000, noise=0.002, random_state=0)
train, test = record.split(0.5)
print(record)

# %%
# Fit and score
# -------------
# ``score`` is R2 of the free-run simulation on fresh data: the model sees the input
# alone, the output only in the first samples, to find its initial state.

# gamma_h keeps the law small, so that the loop stays where the data are
options = {"nx": 6, "n_h": 5, "n_g": 5, "gamma_h": 1e-4, "n_init": 1}
model = AlSsnn(dt=record.dt, random_state=0, **options)
model.fit(train.u, train.y)
print(f"R2 on fresh data: {model.score(test.u, test.y):.6f}")
print(f"error on hidden samples: {model.orders_}, chosen decay: {model.alpha_:g}")

# %%
# How linear is it?
# -----------------
# The ratio of norms belongs to the coordinates of the state.  The linearization error
# does not: it says what share of the *output* is not the response of the linear part,
# once the law has cancelled h.

left = model.linearizability(test.u, test.y)
print(left)

# sphinx_gallery_start_ignore
assert model.score(test.u, test.y) > 0.999
assert left.ratio_g_mean < 0.2 and left.linearization_error[0] < 0.05
# sphinx_gallery_end_ignore

# %%
# The linear part
# ---------------
# It goes to python-control for the design of a controller.

print(np.round(model.to_statespace().poles(), 3))

# %%
# All models at once
# ------------------
# ``model_ladder`` fits a linear, an exactly linearizable, an approximately linearizable
# and a free model to the same data and shows them side by side.  With a decay of the
# networks that is given (``alpha``), nothing is searched: this takes seconds.

import matplotlib.pyplot as plt

from alssnn import model_ladder
from alssnn.plotting import plot_ladder

options |= {"n_f": 8, "alpha": 1e-5, "dt": record.dt}
ladder = model_ladder(train.u, train.y, test=test, **options)
print(ladder)
_, axes = plt.subplots(3, 1, figsize=(9, 9), layout="constrained")
plot_ladder(ladder, axes=axes, unit="V")
plt.show()
