"""
Before the model
================

How nonlinear is a plant, of which kind, and how accurate can a model be? A record of
random multisines tells, before anything is fitted. The plant is a Duffing oscillator, a
mass on a spring that hardens, whose position has 1 % of noise.
"""

import control
import matplotlib.pyplot as plt
import numpy as np

from alssnn.datasets import make_duffing
from alssnn.excitation import multisine
from alssnn.nonparametric import best_linear_approximation

oscillator = make_duffing(10)
plant, dt = oscillator.plant, oscillator.dt


def measure(excitation):
    rng = np.random.default_rng(0)
    outputs = []
    for u in excitation.experiments:
        t = excitation.dt * np.arange(len(u))
        y = control.input_output_response(plant, t, u[:, 0]).outputs
        outputs.append(y + 0.01 * y.std() * rng.standard_normal(len(y)))
    return np.concatenate(outputs)


# %%
# The excitation: four draws of the phases, three periods each, within +-0.5.

options = {"dt": dt, "band": (0.01, 0.45), "random_state": 0}
excitation = multisine(512, low=-0.5, high=0.5, **options)
_ = excitation.plot([*plt.subplots(1, 2, figsize=(11, 3), layout="constrained")[1]])

# %%
# What repeats from period to period is no noise, and what repeats from one draw of the
# phases to the next is linear.

bla = best_linear_approximation(excitation, measure(excitation))
bla.plot([*plt.subplots(1, 2, figsize=(11, 4), layout="constrained")[1]])
print(bla)
print(f"no model below:        {bla.noise_rms[0]:.2g}")
print(f"no linear model below: {bla.total_rms[0]:.2g}")

# sphinx_gallery_start_ignore
assert bla.total_rms[0] > 10 * bla.noise_rms[0] and bla.p_linear < 0.01
# sphinx_gallery_end_ignore

# %%
# An odd grid, one line of every four left out at random: one draw is enough, and the
# lines between the excited ones show that the spring is odd. With a larger amplitude
# the best linear approximation is another one: the spring is stiffer on average.

_, ax = plt.subplots(1, 2, figsize=(11, 4), layout="constrained")
for amplitude, color in ((0.2, "C0"), (0.6, "C1")):
    limits = {"low": -amplitude, "high": amplitude}
    sparse = multisine(2048, grid="odd-random", n_realizations=1, **limits, **options)
    fast = best_linear_approximation(sparse, measure(sparse))
    f, label = fast.frequencies, f"|u| < {amplitude}"
    ax[0].semilogy(f, np.abs(fast.G[:, 0, 0]), color, label=label)
    for level, marker in (("odd", "-"), ("even", "."), ("noise", "--")):
        rms = getattr(fast, level)[:, 0]
        rms = np.where(rms > 0, rms, np.nan)  # nothing but noise was seen there
        ax[1].semilogy(f, rms, color + marker, label=f"{level}, {label}")
ax[0].set(xlabel="frequency, Hz", ylabel="|G|, position over force")
ax[1].set(xlabel="frequency, Hz", ylabel="rms of a line of the position")
ax[0].legend()
ax[1].legend(loc="upper left", bbox_to_anchor=(1, 1), fontsize="small")
plt.show()
