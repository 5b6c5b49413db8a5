"""Certificates of the whole loop of a controller around its model.

Two statements, of one region.  For every reference within an amplitude and every noise
of the sensors within another one, from rest: the distance from the linear design, and
the range of u, have proved bounds (eq. local).  Over the region that this loop does not
leave neurons have slopes within intervals, with which one linear matrix inequality (eq.
slopes) proves a gain, and a rate at which two of its trajectories approach each other.
"""

from dataclasses import dataclass, replace

import numpy as np

from ..lure import Lure
from ._amplitudes import checked_sizes, record_box, sizes_in_words, within_record
from ._gain import GainCertificate, gain_certificate
from ._local import LocalCertificate, local_certificate
from ._whole import whole_loop

DEVIATIONS = 3.0  # of the residual of the fit, the noise that is allowed for
HALVES = 6  # amplitudes that are tried, each half of the one before
RATES = 6  # bisections of the rate


@dataclass(frozen=True, eq=False, repr=False)
class LoopCertificate:
    """Hold what is proved of a controller around its model.

    Parameters
    ----------
    local : LocalCertificate
        Distance from the linear design, for all references and noises within
        ``local.amplitude``: references, measured disturbances, noise of each sensor.
    gain : GainCertificate
        Incremental gain from these inputs to y over the region of `local`.
    rate : GainCertificate
        Certificate of the rate ``rate.decay`` per sample at which two trajectories of
        the region approach each other while their inputs are equal, in the norm of
        ``rate.P``; `gain` itself if no rate below 1 was proved.
    u_low, u_high : ndarray of shape (nv,)
        Proved range of u, in its units.
    reaches_limits : ndarray of bool, shape (nv,)
        Whether u may be at a limit of the actuator.
    full : ndarray of shape (n,)
        Amplitude that was asked for, or that of the training record.

    Examples
    --------
    >>> record = alssnn.datasets.make_wiener_hammerstein(800, random_state=0)
    >>> model = alssnn.LinearStateSpace(nx=4, dt=record.dt).fit(*record)
    >>> certificate = model.controller().certificate()
    >>> certificate.holds, certificate.gain.holds
    (True, True)
    """

    local: LocalCertificate
    gain: GainCertificate
    rate: GainCertificate
    u_low: np.ndarray
    u_high: np.ndarray
    reaches_limits: np.ndarray
    full: np.ndarray

    @property
    def holds(self):
        """Return whether a region was proved that the loop does not leave."""
        return self.local.holds

    @property
    def decay(self):
        """Return the proved rate per sample, 1 if there is none below."""
        return self.rate.decay

    @property
    def output_bound(self):
        """Return the proved supremum of ``|y - y_design|``, in the units of y."""
        return self.local.output_bound

    def verify(self):
        """Recompute region, bounds and inequality, with NumPy alone.

        Returns
        -------
        margin : float
            The smallest of the margins; not negative if and only if all are valid.
        """
        margin = self.local.verify()
        if not self.gain.holds:
            return margin
        return min(margin, self.gain.verify(), self.rate.verify())

    def __repr__(self):
        """Return the certificate as a few lines."""
        lines = [repr(self.local).replace("LocalCertificate", "LoopCertificate")]
        if self.holds:
            if np.any(self.local.amplitude < self.full):
                full = sizes_in_words(self.full, self.local.labels)
                lines.append(f"  nothing is proved for the whole range, {full}")
            u = ", ".join(
                f"{low:.4g} to {high:.4g}{' (at a limit)' if reaches else ''}"
                for low, high, reaches in zip(
                    self.u_low, self.u_high, self.reaches_limits, strict=True
                )
            )
            lines.append(f"  u stays within {u}")
            rate = f", at {self.decay:.4g} per sample" if self.decay < 1 else ""
            proved = (
                f"two trajectories approach each other{rate}; l2 gain to y at most "
                f"{self.gain.gamma:.4g}"
                if self.gain.holds
                else f"no gain was proved. {self.gain.reason}"
            )
            lines.append(f"  {proved}")
        return "\n".join(lines)


def certify_loop(controller, amplitude=None, *, noise=None, search=True):
    """Certify the whole loop of a controller around its own model.

    Parameters
    ----------
    controller : LinearizingController
        Controller with a gain, a law and an observer of constant gain.
    amplitude : float, array_like of shape (nr,) or None, default=None
        Largest modulus of every reference around the operating point, in its units.
        None takes what keeps the design within the training record, or half of it, a
        quarter and so on, until a region and a gain are proved.
    noise : float, array_like of shape (ny,) or None, default=None
        Largest modulus of the noise of every sensor, in the units of y. None takes
        three standard deviations of what the fit leaves. 0 leaves out the observer,
        whose estimate is then exact.
    search : bool, default=True
        Whether the worst input is looked for.

    Returns
    -------
    certificate : LoopCertificate
        The certificate; one that does not hold says why.

    Raises
    ------
    ValueError
        If an argument has the wrong shape, or the loop is none that can be certified:
        the law is solved at every sample, y depends on u of the same sample, or there
        is no gain.
    """
    own = controller.own
    noise = _noise(own, noise)
    loop = whole_loop(controller, observer=bool(np.any(noise)))
    sizes = _sizes(controller, loop.design, amplitude, noise)
    shares = [1.0] if amplitude is not None else 0.5 ** np.arange(HALVES)
    nr = own.ny if controller.tracks else own.nv
    by_y = _channels(loop.lure, own.ny)
    tries = []
    for share in shares:
        tried = sizes.copy()
        tried[:nr] *= share
        local = _gated(_local(loop, tried, own, search=False), controller)
        gain = _gain(by_y, local)
        tries.append((local, gain, tried))
        if gain.holds and local.holds:
            break
    local, gain, tried = max(tries, key=lambda one: (one[0].holds, one[1].holds))
    if search:
        local = _gated(_local(loop, tried, own, search=True), controller)
    references = (
        own.outputs if controller.tracks else [own.inputs[i] for i in own.moved]
    )
    labels = [f"r of {name}" for name in references]
    labels += [own.inputs[i] for i in own.given]
    labels += [f"noise of {name}" for name in own.outputs] if np.any(noise) else []
    local = replace(local, labels=tuple(labels))
    low, high, reaches = _inputs(local, controller.law, own)
    rate = _rate(by_y, local, gain)
    return LoopCertificate(local, gain, rate, low, high, reaches, sizes)


def _local(loop, sizes, own, search):
    """Return the local certificate of a loop."""
    return local_certificate(
        loop.lure,
        loop.design,
        sizes,
        scale=own.y_scale,
        search=search,
        twins=loop.twins,
        watched=loop.lure.nz - own.ny,
    )


def _gated(local, controller):
    """Return a certificate that holds only while the gate of the observer is open."""
    own, gate = controller.own, getattr(controller.observer, "largest_innovation", None)
    if gate is None or not len(local.z_low[own.nv :]):
        return local
    reach = np.maximum(np.abs(local.z_low), np.abs(local.z_high))[own.nv :]
    if np.all(reach <= gate):
        return local
    reason = (
        f"What corrects the estimate may reach {np.max(reach):.4g}, beyond the gate of "
        f"the observer, {np.min(gate):.4g}. Give less noise, or an observer without."
    )
    nowhere = np.full_like(local.output_bounds, np.inf)
    return replace(local, holds=False, output_bounds=nowhere, reason=reason, proof=None)


def _gain(lure, local, decay=1.0):
    """Return the certificate of the gain over a region."""
    if not local.holds:  # what holds everywhere may not know of a gate
        found = gain_certificate(lure)
        return replace(found, holds=False, reason="No region was proved.")
    return gain_certificate(lure, local.proof.slopes(lure.sigma), decay=decay)


def _rate(lure, local, gain):
    """Return the certificate of the smallest rate, by bisection."""
    if not gain.holds:
        return gain
    radius = float(np.abs(np.linalg.eigvals(lure.M[: lure.nx, : lure.nx])).max())
    best, fast = gain, min(radius, 1.0)
    for _ in range(RATES):
        tried = (best.decay + fast) / 2
        found = _gain(lure, local, tried)
        if found.holds:
            best = found
        else:
            fast = tried
    return best


def _channels(lure, n):
    """Return a form with its first n channels."""
    Theta = np.delete(lure.Theta, np.arange(lure.nx + n, lure.nx + lure.nz), axis=0)
    return Lure(Theta, lure.nx, lure.nu, lure.nw, lure.sigma)


def _noise(own, noise):
    """Return the noise of every sensor."""
    if noise is None:
        return DEVIATIONS * np.sqrt(max(own.noise, 0.0)) * own.y_scale
    return checked_sizes("noise", noise, own.ny, zero=True)


def _sizes(controller, design, amplitude, noise):
    """Return the amplitude of references, disturbances and noise."""
    own, box = controller.own, record_box(controller.own)
    of_r = box[own.nu :] if controller.tracks else box[own.moved]
    sizes = np.concatenate([of_r, box[list(own.given)], noise if np.any(noise) else []])
    return within_record(own, design, sizes, amplitude, np.arange(len(of_r)))


def _inputs(local, law, own):
    """Return the range of u, and whether it may be at its limits."""
    nowhere = np.full(own.nv, np.inf)
    if not local.holds:
        return -nowhere, nowhere, np.isfinite(law.u_min) | np.isfinite(law.u_max)
    low, high = local.z_low[: own.nv], local.z_high[: own.nv]
    low, high = low + own.v_offset, high + own.v_offset
    reaches = (low <= law.u_min) | (high >= law.u_max)
    return np.maximum(low, law.u_min), np.minimum(high, law.u_max), reaches
