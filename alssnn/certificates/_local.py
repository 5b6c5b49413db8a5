"""Local certificates: every bounded input, and what the loop then does (eq. local).

A loop and the linear loop that it was designed as start at rest and receive the same
input, |r_i| <= amplitude_i.  As long as the loop is in a region, it is one of the
trajectories of a linear system with bounded remainders (`_covers`), whose region
follows from peak gains (`_peaks`).  If that region lies within the one that was
assumed, the loop never leaves it: the first sample at which it did would contradict
those before.  The same peak gains bound the distance of y from the linear design.  The
part of the remainders that is linear in x and r is in the system: it costs nothing.

The smallest region is searched by repetition, from that of the design outwards.
"""

import time
import warnings
from dataclasses import dataclass, replace
from functools import partial

import numpy as np
from scipy.linalg import solve_discrete_lyapunov

from ..checks import is_count
from ..steady import slope_at_rest
from ._amplitudes import checked_sizes, peaks_of, sizes_in_words
from ._cells import Network
from ._covers import Affine, covers
from ._grid import CELLS, Grid
from ._peaks import TooSlow
from ._proof import Proof
from ._worst import worst_input

NOTHING = 1e-8  # of what the design may reach: a distance that is none
SEARCH = 200  # repetitions with remainders of samples
SETTLED = 2e-3  # relative change of the region at which the search ends
PROOFS = 20  # repetitions with bounded remainders
GROWTH = 1.01  # of the region before each of them
LEAST = 1e-9  # half width of a range that is a point
FLAT = 1e-10  # variance of a direction over the largest: less is rounding
TOO_LARGE = 1e3  # region over that of the design


@dataclass(frozen=True, eq=False, repr=False)
class LocalCertificate:
    """Hold a bound of the distance to the linear design, for all bounded inputs.

    Parameters
    ----------
    holds : bool
        Whether a region was found that the loop does not leave.
    amplitude : ndarray of shape (nr,)
        Largest modulus of every input, around the operating point, in its units.
    output_bounds : ndarray of shape (ny,)
        Proved supremum of ``|y - y_lin|``, in the units of y; inf without a region.
    lower_bounds : ndarray of shape (ny,)
        Largest distance that an input within the amplitude was found to make: no
        proved bound can be smaller.
    worst_input : ndarray of shape (N, nr)
        The input that makes the largest of them, as a deviation.
    design_peak : ndarray of shape (ny,)
        Largest ``|y_lin|`` itself, as a deviation.
    x_low, x_high : ndarray of shape (nx,)
        Range of every state, as deviations, in the basis of the loop.
    z_low, z_high : ndarray of shape (n_watched,)
        Range of further channels, as deviations.
    method : {"cells", "neurons", ""}
        How the remainders were bounded; empty without a region.
    reason : str
        Why it does not hold; empty otherwise.
    solve_time : float
        Time of the search for region and worst input, in seconds.
    labels : tuple of str, default=()
        Names of the inputs, for the display.

    Examples
    --------
    >>> record = alssnn.datasets.make_wiener_hammerstein(800, random_state=0)
    >>> model = alssnn.LinearStateSpace(nx=4, dt=record.dt).fit(*record)
    >>> certificate = model.local_certificate()
    >>> certificate.holds, certificate.output_bound < 1e-6
    (True, True)
    """

    holds: bool
    amplitude: np.ndarray
    output_bounds: np.ndarray
    lower_bounds: np.ndarray
    worst_input: np.ndarray
    design_peak: np.ndarray
    x_low: np.ndarray
    x_high: np.ndarray
    z_low: np.ndarray
    z_high: np.ndarray
    method: str
    reason: str
    solve_time: float
    labels: tuple = ()
    proof: Proof | None = None

    @property
    def output_bound(self):
        """Return the largest of the bounds, in the units of y."""
        return float(np.max(self.output_bounds))

    @property
    def lower_bound(self):
        """Return the largest distance that was found, in the units of y."""
        return float(np.max(self.lower_bounds))

    @property
    def ratio(self):
        """Return the largest proved bound over what was found; nan without a search."""
        if not self.holds:
            return np.inf
        if not len(self.worst_input):
            return np.nan
        small = NOTHING * self.design_peak
        least = np.maximum(self.lower_bounds, small)
        none = self.output_bounds <= small
        return float(np.max(np.where(none, 1.0, self.output_bounds / least)))

    @property
    def verdict(self):
        """Return "holds", "does not hold" (an input diverges), or "undecided"."""
        if self.holds:
            return "holds"
        return "undecided" if np.isfinite(self.lower_bounds).all() else "does not hold"

    def verify(self):
        """Recompute the proof: remainders, region and bounds, with NumPy alone.

        Returns
        -------
        margin : float
            Least distance of the region that follows from the one that was assumed,
            over its width; not negative if and only if the certificate is valid.
        """
        if not self.holds or self.proof is None:
            return -np.inf
        margin, bounds = self.proof.check()
        ranges = (self.x_low, self.x_high), (self.z_low, self.z_high)
        proved = self.proof.range_of_states(), self.proof.channels()
        is_said = np.array_equal(self.amplitude, self.proof.amplitude)
        is_said &= bool(np.all(bounds <= self.output_bounds * (1 + 1e-9)))
        for (low, high), found in zip(ranges, proved, strict=True):
            slack = 1e-9 * np.maximum(np.abs(found).max(axis=0, initial=0.0), 1e-300)
            is_said &= bool(np.all(low <= found[0] + slack))
            is_said &= bool(np.all(high >= found[1] - slack))
        return margin if is_said else -np.inf

    def __repr__(self):
        """Return the certificate as a few lines."""
        size = sizes_in_words(self.amplitude, self.labels)
        found, over = "", ""
        if len(self.worst_input):
            found = f"\n  found: an input with |y - y_lin| = {self.lower_bound:.4g}"
            over = f"; proved over found {self.ratio:.3g}"
        if not self.holds:
            return f"LocalCertificate: {self.verdict} for {size}. {self.reason}{found}"
        return (
            f"LocalCertificate: holds for every input with {size}, from rest\n"
            "  r and y_lin count from the operating point\n"
            f"  proved: |y - y_lin| <= {self.output_bound:.4g}, where |y_lin| may "
            f"reach {np.max(self.design_peak):.4g}{found}{over}\n"
            "  of the model: the plant may differ from it"
        )


def local_certificate(
    lure,
    design,
    amplitude,
    *,
    scale=None,
    search=True,
    cells=CELLS,
    twins=(),
    watched=0,
):
    """Bound the distance of a loop from its linear design (eq. local).

    Parameters
    ----------
    lure : Lure
        Loop from r to its channels, of which the first are y; deviations.
    design : tuple of ndarray
        (A, B, C, D) of the linear design, with the same inputs and outputs y. It
        may have other states.
    amplitude : array_like of shape (nr,)
        Largest modulus of every input, in its units.
    scale : array_like of shape (ny,) or None, default=None
        Sizes of the outputs, which make them comparable; None means ones.
    search : bool, default=True
        Whether the worst input is looked for.
    cells : int, default=300_000
        Cells of a grid of states and inputs, which bounds the distance of loops of up
        to 3 states and 2 inputs more closely (eq. grid); 0 for none.
    twins : sequence of int, default=()
        For every neuron another one of equal weights at another point, from which it
        differs little, as that of an observer; -1 for none.
    watched : int, default=0
        Channels behind y whose range is asked for.

    Returns
    -------
    certificate : LocalCertificate
        The certificate; one that does not hold says why.

    Notes
    -----
    Seconds for a loop of up to 5 states and inputs, which is subdivided into up to
    40,000 cells, a few times; less than a second without. Some seconds more for the
    grid: its time grows with `cells`. The search of the input costs some hundred
    simulations.
    """
    start = time.perf_counter()
    ny = len(design[2])
    if not is_count(cells, 0):
        raise ValueError(
            f"`cells` must be an integer of at least 0, got {cells!r}. 0 leaves out "
            "the grid."
        )
    amplitude = checked_sizes("amplitude", amplitude, lure.nu, zero=True)
    if not amplitude.any():
        raise ValueError(
            "`amplitude` must be positive for an input, got zeros. With no input there "
            "is no worst one."
        )
    scale = np.ones(ny) if scale is None else np.asarray(scale, dtype=float)
    linear, none = peaks_of(design, amplitude), partial(_none, lure, amplitude, start)
    if isinstance(linear, str):
        nothing = np.full(ny, np.inf)
        return none(nothing, np.zeros((0, lure.nu)), nothing, linear)
    peak, length = linear
    lower, worst = np.zeros(ny), np.zeros((0, lure.nu))
    if search:
        lower, worst = worst_input(lure, design, amplitude, length)
    if not np.isfinite(lower).all():
        reason = "The loop diverges for the worst input that was found."
        return none(lower, worst, peak, reason)
    steep = [z.name for z in lure.sigma if not np.isfinite(z.slope).all()]
    if steep:
        reason = f"The activation {steep[0]!r} has no bounded slope."
        return none(lower, worst, peak, reason)
    network, scaled, T = _scaled(lure, design, amplitude, scale, twins, watched)
    bounds, proof = _least(network, scaled, scale, amplitude, T)
    if proof is None:
        return none(lower, worst, peak, bounds)
    if cells and Grid.suits(network, scaled):
        proof = replace(proof, cells=int(cells))
        bounds = proof.check()[1]
    if np.any(lower > bounds * (1 + 1e-9) + NOTHING * peak):  # never seen
        reason = "Numbers contradict each other: units or weights are extreme."
        return none(lower, worst, peak, reason)
    x_low, x_high = proof.range_of_states()
    z_low, z_high = proof.channels()
    return replace(
        none(np.minimum(lower, bounds), worst, peak, ""),  # what is above is rounding
        holds=True,
        output_bounds=bounds,
        x_low=x_low,
        x_high=x_high,
        z_low=z_low,
        z_high=z_high,
        method=proof.cover.name,
        proof=proof,
    )


def _least(network, scaled, scale, amplitude, T):
    """Return the least bounds that a cover proves and its proof, or why none does."""
    proofs, reason = [], ""
    for cover in covers(network, scaled):
        region, reason = _invariant(cover)
        if region is not None:
            proof = Proof(cover, region, scaled, scale, amplitude, T)
            proofs.append((proof.check()[1], proof))
    if not proofs:
        return reason, None
    return min(proofs, key=lambda found: np.max(found[0] / scale))


def _scaled(lure, design, amplitude, scale, twins=(), watched=0):
    """Return network and design in coordinates of about unit size, and the basis."""
    A, B, C, D = design
    B, D = B * amplitude, D * amplitude
    own = _basis(A, B)
    same = len(A) == lure.nx
    T = own if same else _basis(_linear_part(lure), lure.M[: lure.nx, lure.nx :])
    units = np.concatenate([scale, np.ones(watched)])
    network = Network.of(lure, len(units), T, amplitude, units, twins)
    solve = np.linalg.solve
    nx, ny = len(A), len(C)
    scaled = Affine(
        solve(own, A @ own),
        solve(own, B),
        np.zeros(nx),
        C @ own / scale[:, None],
        D / scale[:, None],
        np.zeros(ny),
        np.zeros((nx, 0)),
        np.zeros((ny, 0)),
        np.zeros(0),
        np.zeros((0, nx + amplitude.size + 1)),
    )
    return network, scaled, T


def _basis(A, B):
    """Return the principal axes of what inputs of variance one make of the states."""
    with warnings.catch_warnings():  # of units far apart: any basis is one
        warnings.simplefilter("ignore")
        Q = solve_discrete_lyapunov(A, B @ B.T)
    sizes, axes = np.linalg.eigh((Q + Q.T) / 2)
    if sizes[0] > FLAT * sizes[-1]:
        return axes * np.sqrt(sizes)
    # states in units far apart: each in one of its own
    unit = np.sqrt(np.maximum(np.diag(Q), FLAT**2 * sizes[-1] + 1e-300))
    sizes, axes = np.linalg.eigh((Q + Q.T) / (2 * np.outer(unit, unit)))
    return unit[:, None] * axes * np.sqrt(np.maximum(sizes, FLAT * sizes[-1]))


def _linear_part(lure):
    """Return the Jacobian of x+ at the origin, a stable one for the sake of a basis."""
    A = slope_at_rest(lure)
    return A / max(1.0, 1.01 * float(np.abs(np.linalg.eigvals(A)).max()))


def _invariant(cover):
    """Return a region that the loop does not leave, or None and the reason."""
    region = cover.start
    largest = TOO_LARGE * max(1.0, float(np.abs(region).max(initial=0.0)))
    try:
        width = 0.0
        for _ in range(SEARCH):
            region = cover.system(region, exact=False).region()
            if np.abs(region).max(initial=0.0) > largest:
                return None, "No region was found: remainders grow with the states."
            wider = float(np.sum(region[1] - region[0]))
            if abs(wider - width) <= SETTLED * wider:
                break
            width = wider
        for _ in range(PROOFS):
            middle, half = region.mean(axis=0), (region[1] - region[0]) / 2
            half = GROWTH * half + LEAST
            assumed = np.stack([middle - half, middle + half])
            found = cover.system(assumed).region()
            if np.all(found[0] >= assumed[0]) and np.all(found[1] <= assumed[1]):
                return assumed, ""
            if np.abs(found).max(initial=0.0) > largest:
                break
            region = found
    except (TooSlow, np.linalg.LinAlgError) as problem:
        cover = "The loop is bounded by a linear system with remainders."
        return None, f"No region was found. {cover} {problem}"
    return None, "No region was found that the loop provably does not leave."


def _none(lure, amplitude, start, lower, worst, peak, reason):
    """Return the certificate that does not hold."""
    nowhere, none = np.full(lure.nx, np.inf), np.zeros(0)
    return LocalCertificate(
        holds=False,
        amplitude=amplitude,
        output_bounds=np.full(len(peak), np.inf),
        lower_bounds=lower,
        worst_input=worst,
        design_peak=peak,
        x_low=-nowhere,
        x_high=nowhere,
        z_low=none,
        z_high=none,
        method="",
        reason=reason,
        solve_time=time.perf_counter() - start,
    )
