"""Certificates of the whole loop of a controller around its model.

Two statements, of one region.  For every reference within an amplitude and every noise
of the sensors within another one, from rest: the distance from the linear design, and
the range of u, have proved bounds (eq. local).  Over the region that this loop does not
leave neurons have slopes within intervals, with which one linear matrix inequality (eq.
slopes) proves a gain from the references to the distance from the design (eq.
distance), for every plant near the model; the rate at which the loop comes to rest, and
from which states it does (eq. basin).
"""

from dataclasses import dataclass, replace

import numpy as np

from ..checks import numbers_of_shape
from ._amplitudes import checked_sizes, record_box, sizes_in_words, within_record
from ._error_gain import ErrorGain
from ._gain import GainCertificate, gain_certificate
from ._grid import CELLS
from ._local import LocalCertificate, local_certificate
from ._rest import LoopProof
from ._tube_bound import in_words, plain
from ._whole import whole_loop

DEVIATIONS = 3.0  # of the residual of the fit, the noise that is allowed for
HALVES = 6  # amplitudes that are tried, each half of the one before
RATES = 6  # bisections of the rate
FACTORS = 8  # bisections of the error, on a logarithmic scale
FURTHEST = 64.0  # factor on the error that is tried


@dataclass(frozen=True, eq=False, repr=False)
class LoopCertificate:
    """Hold what is proved of a controller around its model.

    Parameters
    ----------
    local : LocalCertificate
        Distance from the linear design, for all references and noises within
        ``local.amplitude``: references, measured disturbances, noise of each sensor.
    gain : GainCertificate
        Gain in l2 from references and measured disturbances to y - y_design, while the
        loop stays in the region of `local` and the plant differs from the model by no
        more than `error`. It starts where it rests without inputs (`x_rest`), and y and
        u count from there. No sensor has noise, which moves y from the design, too.
    rate : GainCertificate
        Certificate of the rate ``rate.decay`` per sample at which the loop comes to
        rest while its inputs are zero, in the norm of ``rate.P``.
    basin : ndarray of shape (nx, nx)
        The loop comes to rest from all states with ``x' basin x <= 1``, where x counts
        from `x_rest`, in the basis of `A_`, observer and plant start alike, and
        integrators are at rest. Zeros where nothing limits them; nan if none is proved.
    u_low, u_high : ndarray of shape (nv,)
        Proved range of u, in its units.
    reaches_limits : ndarray of bool, shape (nv,)
        Whether u may be at a limit of the actuator.
    full : ndarray of shape (n,)
        Amplitude that was asked for, or that of the training record.
    error : ndarray of shape (ny, nv) or None
        Gain from every u to what the plant adds to every output of the model.
    largest_error : float
        Factor on `error` up to which a gain is proved; nan without an error.
    proof : LoopProof or None, default=None
        What the inequalities are made of; None where nothing was proved.
    has_noise : bool, default=True
        Whether noise of the sensors counts; else the estimate of the state is exact.

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
    basin: np.ndarray
    u_low: np.ndarray
    u_high: np.ndarray
    reaches_limits: np.ndarray
    full: np.ndarray
    error: np.ndarray | None = None
    largest_error: float = np.nan
    proof: LoopProof | None = None
    has_noise: bool = True

    @property
    def holds(self):
        """Return whether a region was proved that the loop does not leave."""
        return self.local.holds

    @property
    def x_rest(self):
        """Return where the plant rests without inputs, a deviation, shape (nx,)."""
        n = len(self.basin)
        return np.full(n, np.nan) if self.proof is None else self.proof.x_rest[:n]

    @property
    def decay(self):
        """Return the proved rate per sample, 1 if there is none below."""
        return self.rate.decay

    @property
    def output_bound(self):
        """Return the proved supremum of ``|y - y_design|``, in the units of y."""
        return self.local.output_bound

    def verify(self):
        """Recompute region, bounds, inequalities and basin, with NumPy alone.

        Returns
        -------
        margin : float
            The smallest of the margins; not negative if and only if all are valid.
        """
        margin, proof = self.local.verify(), self.proof
        if proof is None:  # then nothing but the region can be valid
            return -np.inf if self.gain.holds or self.rate.holds else margin
        found = [margin]
        if not (self.local.holds and proof.is_of(self.local)):
            return -np.inf
        for certificate, form, sectors in (
            (self.gain, *proof.distance(self.error)),
            (self.rate, *proof.deviations()),
        ):
            if certificate.holds:
                is_same = certificate.is_of(form, sectors)
                found.append(certificate.verify() if is_same else -np.inf)
        if not np.isnan(self.basin).all():
            proved = proof.basin(self.rate.P) if self.rate.holds else np.inf
            slack = 1e-9 * float(np.max(np.abs(self.basin)))
            is_same = np.allclose(self.basin, proved, rtol=1e-6, atol=slack)
            found.append(0.0 if is_same else -np.inf)
        return float(min(found))

    def __repr__(self):
        """Return the certificate as a few lines."""
        lines = [repr(self.local).replace("LocalCertificate", "LoopCertificate")]
        if self.holds:
            if np.any(self.local.amplitude < self.full):
                full = sizes_in_words(self.full, self.local.labels)
                both = "region and gain are not both proved for the whole range"
                lines.append(f"  {both}, {full}")
            u = ", ".join(
                f"{low:.4g} to {high:.4g}{' (at a limit)' if reaches else ''}"
                for low, high, reaches in zip(
                    self.u_low, self.u_high, self.reaches_limits, strict=True
                )
            )
            of = ", noise included" if self.has_noise else "; the estimate is exact"
            lines.append(f"  y_lin is the design under the same inputs{of}")
            lines += [f"  u stays within {u}", f"  {self._of_gain()}"]
            if self.rate.holds:
                lines.append(f"  {self._of_rate()}")
        return "\n".join(lines)

    def _of_gain(self):
        near = ""
        if not self.gain.holds:
            if self.largest_error == 0:
                near = " The `error` is too large for this loop."
            if self.largest_error > 0:
                near = f" It holds for {self.largest_error:.3g} times this `error`."
            return f"no gain was proved. {self.gain.reason}{near}"
        if self.error is not None:
            size = in_words(self.error)
            near = (
                f", for every plant with |y_plant - y_model| <= {size} |u|"
                f" (proved up to {self.largest_error:.3g} times that), as long as this"
                " difference is smaller than the noise"
            )
        n_free = 0 if self.proof is None else self.proof.n_free
        labels = self.local.labels[:n_free]
        # measured disturbances count among the inputs, noise does not
        of = "|r|" if all(label.startswith("r of ") for label in labels) else "|r, d|"
        without = " without noise" if self.has_noise else ""
        bound = f"|y - y_design| <= {self.gain.gamma:.4g} {of} in l2{without}"
        return f"{bound}, from x_rest, and y and u count from there{near}"

    def _of_rate(self):
        at = f" at {self.decay:.4g} per sample" if self.decay < 1 else ""
        if np.isnan(self.basin).any():
            return f"comes to rest{at}, from states near rest"
        if not self.basin.any():
            return f"comes to rest{at}, from every state"
        root = np.sqrt(np.diag(np.linalg.pinv(self.basin)))
        inside = f"an ellipsoid of |x - x_rest| <= {plain(root)}"
        return f"comes to rest{at}, from states in {inside}"


def certify_loop(controller, amplitude=None, *, noise=None, error=None, search=True):
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
        three standard deviations of what the fit leaves, relative to the output, on
        average over the outputs. 0 leaves out the observer, whose estimate is then
        exact.
    error : ErrorGain, float, array_like of shape (ny, nv) or None, default=None
        Largest l2 gain from u to what the plant adds to the output of the model, units
        of y per unit of u, see `error_gain`; None takes the model for the plant. It
        enters the gain; the region takes what the plant adds as noise.
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
        the law looks ahead, y depends on u of the same sample, or there is no gain.
    """
    own = controller.own
    noise, error = _noise(own, noise), _error(own, error)
    if error is not None and not np.any(noise):
        raise ValueError(
            "`noise` must be positive with an `error`, got 0. What the plant adds to "
            "the output of the model counts as noise: give its largest modulus."
        )
    loop = whole_loop(controller, observer=bool(np.any(noise)))
    sizes = _sizes(controller, loop.design, amplitude, noise)
    shares = [1.0] if amplitude is not None else 0.5 ** np.arange(HALVES)
    nr = own.ny if controller.tracks else own.nv
    tries = []
    for share in shares:
        tried = sizes.copy()
        tried[:nr] *= share
        local = _gated(_local(loop, tried, own, search=False), controller)
        proof = _proof(loop, local, controller)
        gain = _gain(proof, error)
        tries.append((local, proof, gain, tried))
        if gain.holds and local.holds:
            break
    local, proof, gain, tried = max(tries, key=lambda one: (one[0].holds, one[2].holds))
    if search:
        local = _gated(_local(loop, tried, own, search=True), controller)
        if not local.holds:  # the search has found more
            proof = local.reason
            gain = _gain(proof, error)
    references = (
        own.outputs if controller.tracks else [own.inputs[i] for i in own.moved]
    )
    labels = [f"r of {name}" for name in references]
    labels += [own.inputs[i] for i in own.given]
    labels += [f"noise of {name}" for name in own.outputs] if np.any(noise) else []
    local = replace(local, labels=tuple(labels))
    rate, nowhere = _rate(proof), np.full((own.nx, own.nx), np.nan)
    u_low, u_high, reaches_limits = _inputs(local, controller.law, own)
    return LoopCertificate(
        local=local,
        gain=gain,
        rate=rate,
        basin=proof.basin(rate.P) if rate.holds else nowhere,
        u_low=u_low,
        u_high=u_high,
        reaches_limits=reaches_limits,
        full=sizes,
        error=error,
        largest_error=np.nan if error is None else _largest_error(proof, error, gain),
        proof=proof if isinstance(proof, LoopProof) else None,
        has_noise=bool(np.any(noise)),
    )


def _proof(loop, local, controller):
    """Return what the inequalities are made of, or why there is nothing."""
    if not local.holds:
        return "No region was proved."
    return LoopProof.of(loop, local, controller)


def _local(loop, sizes, own, search):
    """Return the local certificate of a loop."""
    return local_certificate(
        loop.lure,
        loop.design,
        sizes,
        scale=own.y_scale,
        search=search,
        cells=CELLS if search else 0,
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


def _gain(proof, error):
    """Return the certificate of the gain to the distance from the design."""
    if isinstance(proof, str):
        return GainCertificate.none(proof)
    return gain_certificate(*proof.distance(error))


def _rate(proof):
    """Return the certificate of the smallest rate, by bisection."""
    if isinstance(proof, str):
        return GainCertificate.none(proof)
    form, sectors = proof.deviations()
    best = gain_certificate(form, sectors)
    if not best.holds:
        return best
    # what holds has its poles inside the unit circle
    fast = float(np.abs(np.linalg.eigvals(form.M[: form.nx, : form.nx])).max())
    for _ in range(RATES):
        tried = (best.decay + fast) / 2
        found = gain_certificate(form, sectors, decay=tried)
        if found.holds:
            best = found
        else:
            fast = tried
    return best


def _largest_error(proof, error, gain):
    """Return the factor on the error up to which a gain is proved, by bisection."""
    if isinstance(proof, str):
        return np.nan
    low, high = (1.0, FURTHEST) if gain.holds else (1 / FURTHEST, 1.0)
    if not gain.holds and not _gain(proof, low * error).holds:
        return 0.0
    for _ in range(FACTORS):
        tried = float(np.sqrt(low * high))
        low, high = (tried, high) if _gain(proof, tried * error).holds else (low, tried)
    return low


def _error(own, error):
    """Return the gain of the error of the model, or None."""
    if error is None:
        return None
    shape = own.ny, own.nv
    given = error.gain if isinstance(error, ErrorGain) else error
    gain = numbers_of_shape(given, shape)
    if not np.isfinite(gain).all() or np.any(gain < 0):
        remedy = " Take `certificates.error_gain`, or None."
        raise ValueError(
            f"`error` must be at least 0 and finite, one number or of shape {shape}, "
            f"got {error!r}{'' if isinstance(error, ErrorGain) else '.' + remedy}"
        )
    return gain if np.any(gain) else None


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
