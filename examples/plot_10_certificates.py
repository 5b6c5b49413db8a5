r"""
Certificates: how far from linear at most
=========================================

The law :math:`u = v - h(x)` leaves the linear system, disturbed by
:math:`\omega = g(x, v - h)`.  If :math:`|\omega| \le \varepsilon`, an ellipsoid
:math:`x^\top P x \le \psi \varepsilon^2 / \varphi` holds the deviation from the linear
response for all time and whatever :math:`v` is (:eq:`lmi`).
"""

# %%
# Model and certificate
# ---------------------
# A contraction, as by default, keeps the basis of the states from hiding g.

import numpy as np

from alssnn import AlSsnn
from alssnn.datasets import make_pendulum

record = make_pendulum(3_000, noise=0.005, random_state=0)
train, test = record.split(0.7)
model = AlSsnn(
    nx=2,
    n_h=6,
    n_g=3,
    phi=0.01,
    gamma_h=1e-4,
    operating_point="zero",
    dt=record.dt,
    random_state=0,
).fit(train.u, train.y)
certificate = model.iss_certificate(train.u, train.y)
print(certificate)

# %%
# Trust, but verify
# -----------------
# The margin of the inequality is recomputed from the numbers of the certificate, with
# NumPy alone and without the solver.  There are two bounds on :math:`\omega`: the
# largest value along the data, and one that no input can exceed.  The second one holds
# for any input, but its bound on the deviation is larger than the output's own standard
# deviation, so it says little here.

print(f"margin recomputed: {certificate.verify():.2e}")
everywhere = model.iss_certificate(eps="global")
for name, c in (("along the data", certificate), ("everywhere", everywhere)):
    print(f"{name:15s} |omega| <= {c.eps:.3g}, |y - y_lin| <= {c.output_bound:.3g}")
print(f"std of the output, to compare: {np.std(train.y):.3g}")

# sphinx_gallery_start_ignore
assert certificate.holds and certificate.verify() > 0
assert everywhere.output_bound > max(certificate.output_bound, np.std(train.y))
# sphinx_gallery_end_ignore

# %%
# The set, and trajectories in it
# -------------------------------
# The deviation of the loop from the linear one, along a record the certificate has not
# seen.  How little of the ellipse it uses is what the bound gives away: it holds for
# the worst :math:`\omega`, which keeps pushing into the worst direction.

import matplotlib.pyplot as plt

from alssnn.plotting import CertificateDisplay

_, ax = plt.subplots(figsize=(6, 5), layout="constrained")
display = CertificateDisplay.from_estimator(model, certificate, test.u, test.y, ax=ax)
print(f"samples in the set: {display.inside_:.1%}")

# sphinx_gallery_start_ignore
assert display.inside_ == 1.0
# sphinx_gallery_end_ignore
plt.show()

# %%
# Gain
# ----
# The incremental gain from v to y bounds how far two responses come apart, for any two
# inputs.  It cannot be less than the gain of the linear part.  A proof is not always
# found: the line says so, and then nothing is known either way.

from alssnn.certificates import hinf_norm

print(model.gain_certificate())
print(f"gain of (A, B, C): {hinf_norm(model.A_, model.B_, model.C_):.4g}")
