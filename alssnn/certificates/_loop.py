"""Certificates of a fitted model: which loop they are of, and what they rest on.

The loop is that of `Plant.close`, u = v - h(s) with v = r - K x: past values of late
inputs are states, and a plant whose law is none has no certificate.  It obeys

    x+ = (A - B K) x + B r + omega,    y = (C - D K) x + D r + eta        (eq. eta)

so that y - y_lin is the response of A - B K, C - D K to omega, plus eta at once.
"""

from dataclasses import replace

import numpy as np

from ..lure import Lure
from ..plants import as_plant
from ._amplitudes import record_box, within_record
from ._disturbance import data_bound, global_bound
from ._gain import gain_certificate
from ._iss import iss_certificate
from ._local import local_certificate
from ._state_feedback import (
    full_gain,
    linear_form,
    linearized_loop,
    matrices,
    state_feedback,
)

UNBOUNDED = {
    "data": "The simulated loop diverges on the data.",
    "global": "A neuron in g is unbounded: take eps='data', or a number.",
}


def certify_iss(model, records=None, *, K=None, eps="data", **options):
    """Certify input-to-state stability of a model under its law (eq. lmi).

    Parameters
    ----------
    model : estimator or Plant
        Fitted model.
    records : sequence of PreparedRecord or None, default=None
        Records that bound omega and eta; needed for eps="data".
    K : array_like of shape (nu, nx) or None, default=None
        State feedback v = r - K x, see `full_gain`.
    eps : {"data", "global"} or float, default="data"
        Bound on ``|omega|``: that of `data_bound` or of `global_bound`, or a number;
        with a number eta has its global bound. Where the global bounds are zero, the
        law is exact, and they are taken for "data", too.
    **options : dict
        Options of `iss_certificate`.

    Returns
    -------
    certificate : IssCertificate
        The certificate; one that does not hold says why.

    Raises
    ------
    ValueError
        If an argument is out of range, the records are missing, or the plant has no
        law.
    """
    plant = as_plant(model).late()
    loop = linearized_loop(plant, K)
    source = eps if isinstance(eps, str) else "given"
    if isinstance(eps, str) and eps not in UNBOUNDED:
        raise ValueError(
            f"`eps` must be 'data', 'global' or a number, got {eps!r}. Choose one."
        )
    if source == "data" and not records:
        raise ValueError(
            "`u` and `y` must be given for eps='data', got None. Pass records, or "
            "eps='global'."
        )
    omega, eta = global_bound(plant)
    if source == "data" and not (omega or eta.any()):
        source = "global"  # an exact law leaves nothing, on records and elsewhere
    elif source == "data":
        omega, eta = data_bound(plant, records, K)
    omega = eps if source == "given" else omega
    nx = plant.nx
    A, C = loop.M[:nx, :nx], loop.M[nx : nx + plant.ny, :nx]
    certificate = iss_certificate(A, C, eps=omega, eta=eta, **options)
    certificate = replace(certificate, source=source)
    if source in UNBOUNDED and np.isinf(omega):
        reason = f"{certificate.reason} {UNBOUNDED[source]}"
        certificate = replace(certificate, reason=reason)
    return certificate


def certify_gain(model, K=None):
    """Certify the incremental l2 gain of the linearized loop (eq. slopes).

    The loop is u = v - h, with v = r - K x if `K` is given; the gain is that from
    v, or r, to y.

    Parameters
    ----------
    model : estimator or Plant
        Fitted model, or its `plant_`.
    K : array_like of shape (nu, nx) or None, default=None
        State feedback, in the basis of `A_` and the units of u; with late inputs
        also of shape (nu, nx + n_late), else it does not act on past inputs.

    Returns
    -------
    certificate : GainCertificate
        The smallest gain that slope multipliers prove, in units of y per unit of
        u; one that does not hold says why.

    Raises
    ------
    ValueError
        If `K` has the wrong shape, or u = v - h is no law of this model.
    """
    plant = as_plant(model).late()
    loop = linearized_loop(plant, K)
    u = np.arange(plant.nx + plant.ny, plant.nx + loop.nz)
    Theta = np.delete(loop.Theta, u, axis=0)
    # increments from v: two loops that are compared have the same disturbances
    Theta = np.delete(Theta, plant.nx + np.array(plant.given, dtype=int), axis=1)
    return gain_certificate(Lure(Theta, loop.nx, plant.nv, loop.nw, loop.sigma))


def certify_local(model, amplitude=None, *, K=None, **options):
    """Bound the distance from the linear design for all bounded inputs (eq. local).

    The loop is u = v - h, with v = r - K x if `K` is given, from rest at the operating
    point. Nothing is assumed of g: its weights bound it.

    Parameters
    ----------
    model : estimator or Plant
        Fitted model, or its `plant_`.
    amplitude : float, array_like of shape (nv,) or None, default=None
        Largest modulus of every input v, or r, around the operating point, in the
        units of u. None takes that of the training record, or as much of it as keeps
        the worst linear response within the outputs of the record.
    K : array_like of shape (nu, nx) or None, default=None
        State feedback, in the basis of `A_` and the units of u; with late inputs
        also of shape (nu, nx + n_late), else it does not act on past inputs.
    **options : dict
        `search`, whether the worst input is looked for, a lower bound of any bound
        (default True), and `cells`, of the grid that bounds loops of up to 3 states
        and 2 inputs more closely (default 300,000; 0 for none).

    Returns
    -------
    certificate : LocalCertificate
        Proved bound and worst input found; one that does not hold says why. Measured
        disturbances are inputs, too, with the range of the training record.

    Raises
    ------
    ValueError
        If an argument has the wrong shape or is not positive, or u = v - h is no law
        of this model (`plant_.no_law`).
    """
    plant = as_plant(model).late()
    loop = linearized_loop(plant, K)
    linear = state_feedback(linear_form(plant), full_gain(plant, K), plant.moved)
    design = matrices(linear)
    sizes = record_box(plant)[: plant.nu]
    sizes = within_record(plant, design, sizes, amplitude, plant.moved)
    return local_certificate(loop, design, sizes, scale=plant.y_scale, **options)
