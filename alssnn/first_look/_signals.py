"""Questions to single signals: gaps, limits, steps of a converter, spikes, inputs."""

import numpy as np

from ._findings import Finding

GAPS = 0.05  # share of missing samples from which they cost accuracy
PILED_UP = 3.0  # samples at an extreme value, relative to those at the value beside
SATURATED = 0.005  # share of the samples at an extreme value that are a limit
LEVELS = 20  # different values: fewer are levels that were sent, not a converter
ROUNDING = 1e-10  # step over the range that is one of rounding
COARSE = 0.02  # step of a converter relative to the standard deviation
SPIKE = 12.0  # robust standard deviations of a sample from its neighbors
# what three samples before, three behind, and two at each side foretell of the middle
FORETELL = np.array(
    [
        [1, -3, 3, 0, 0, 0, 0],
        [0, 0, 0, 0, 3, -3, 1],
        [0, -1 / 6, 4 / 6, 0, 4 / 6, -1 / 6, 0],
    ]
)
# what of these six no cubic explains: they are as rough themselves
CUBIC = np.vander([-3.0, -2, -1, 1, 2, 3], 4)
ROUGH = np.insert(np.eye(6) - CUBIC @ np.linalg.pinv(CUBIC), 3, 0.0, axis=1)
LONE = 4.0  # a spike over the roughness of its neighbors; less is a fast motion
COLLINEAR = 0.95  # correlation of two inputs
SQRT12 = np.sqrt(12.0)


def gaps(records):
    """Look for outputs that were not measured.

    Parameters
    ----------
    records : Records
        The experiments.

    Returns
    -------
    finding : Finding
        The largest share of an output.
    """
    shares = np.isnan(records.y).mean(axis=0).tolist()
    missing = dict(zip(records.output_names, shares, strict=True))
    worst = max(missing.values())
    if not worst:
        sentence = "All outputs were measured at all samples."
    else:
        said = ", ".join(f"{100 * s:.1f} % of {n}" for n, s in missing.items() if s)
        sentence = (
            f"Not measured: {said}. A fit bridges gaps by its own simulation; "
            "frequency responses need stretches without one."
        )
    return Finding("gaps", worst, sentence, worst > GAPS)


def saturation(records):
    """Look for outputs that stay at their largest or smallest value.

    Parameters
    ----------
    records : Records
        The experiments.

    Returns
    -------
    finding : Finding
        The largest share of samples at a limit.
    """
    found = {}
    for name, z in zip(records.output_names, records.y.T, strict=True):
        values, counts = np.unique(z[~np.isnan(z)], return_counts=True)
        if len(values) < LEVELS:
            continue
        for end, beside in ((0, 1), (-1, -2)):
            piled = counts[end] > PILED_UP * max(counts[beside], 1)
            share = counts[end] / len(z)
            if piled and share > SATURATED:
                found[f"{name} at {values[end]:.4g}"] = float(share)
    if not found:
        return Finding("saturation", 0.0, "No output stays at an extreme value.", False)
    said = ", ".join(f"{100 * share:.1f} % of {name}" for name, share in found.items())
    return Finding(
        "saturation",
        max(found.values()),
        f"Outputs stay at an extreme value: {said}. Where a sensor was at its limit, "
        "set what it hid to nan, or excite less; a stop is part of the plant.",
        True,
    )


def quantization(records):
    """Look for the step of a converter.

    Parameters
    ----------
    records : Records
        The experiments.

    Returns
    -------
    finding : Finding
        The largest step, relative to the standard deviation of its signal.
    """
    found = {}
    for name, z in zip(records.output_names, records.y.T, strict=True):
        step = _step(z)
        if step:
            found[name] = step, float(step / np.nanstd(z))
    if not found:
        return Finding(
            "quantization", 0.0, "No output shows the step of a converter.", False
        )
    said = ", ".join(f"{step:.3g} of {name}" for name, (step, _) in found.items())
    floor = ", ".join(f"{step / SQRT12:.2g}" for step, _ in found.values())
    worst = max(share for _, share in found.values())
    sentence = (
        f"Outputs come in steps of {said}; this alone makes errors of {floor} rms."
    )
    if worst > COARSE:
        sentence += " That is coarse: amplify the signal, or take a finer converter."
    return Finding("quantization", worst, sentence, worst > COARSE)


def _step(z):
    """Return the step that all values are multiples of; 0 if there is none."""
    values = np.unique(z[~np.isnan(z)])
    if not LEVELS <= len(values) <= len(z) / 2:
        return 0.0
    step = np.diff(values).min()
    if step < ROUNDING * (values[-1] - values[0]):  # no converter has so many bits
        return 0.0
    multiples = np.diff(values) / step
    # values read from a file have few digits
    return float(step) if np.abs(multiples - np.round(multiples)).max() < 0.1 else 0.0


def outliers(records):
    """Look for spikes.

    A spike is far, and to one side, from what the samples before it foretell and from
    what those behind it do, as the edge of a step is not, and from the cubic through
    both, as the crest of a wave is not. Its neighbors are smooth without it, as those
    of a fast motion are not. The three samples at an end, or at a gap, are not judged.

    Parameters
    ----------
    records : Records
        The experiments.

    Returns
    -------
    finding : Finding
        Number of spikes.
    """
    found, first = 0, ""
    for i, name in enumerate(records.output_names):
        for (_, y), label in zip(records.pairs, records.labels, strict=True):
            z = y[:, i]
            if np.sum(~np.isnan(z)) < 10:
                continue
            padded = np.pad(z, 3, constant_values=np.nan)
            around = np.lib.stride_tricks.sliding_window_view(padded, 7)  # (N, 7)
            known = np.isfinite(around).all(axis=1)
            rest = np.where(known, z - FORETELL @ around.T, 0.0)  # (3, N)
            scale = 1.4826 * np.median(np.abs(rest[2, known])) if known.any() else 0.0
            # of a signal that rests most of the time, or of coarse steps
            scale = max(scale, _step(z), 1e-3 * float(np.nanstd(z)))
            rough = np.sqrt(np.sum((ROUGH @ around.T) ** 2, axis=0) / 2)
            far = np.abs(rest).min(axis=0) > np.fmax(SPIKE * scale, LONE * rough)
            spikes = np.flatnonzero(far & (rest[0] * rest[1] > 0))
            found += len(spikes)
            if len(spikes) and not first:
                where = "" if label is None else f" of experiment {label!r}"
                first = f"the first one in {name} at sample {spikes[0]}{where}"
    if not found:
        return Finding("outliers", 0.0, "No output has spikes.", False)
    return Finding(
        "outliers",
        float(found),
        f"{found} samples lie far from their neighbors, {first}. Set them to nan if "
        "they are no motion of the plant.",
        True,
    )


def inputs(records):
    """Ask whether inputs move, and independently of each other.

    Parameters
    ----------
    records : Records
        The experiments.

    Returns
    -------
    finding : Finding
        Largest correlation of two inputs, or of one with a sum of the others if that
        is too large; 1 if one is at rest.
    """
    spread, nu = records.u.std(axis=0), records.nu
    rest = np.compress(records.rests[:nu], records.input_names)
    if len(rest):
        return Finding(
            "inputs",
            1.0,
            f"{', '.join(rest)} does not move: nothing can be learned of it. Leave it "
            "out, or excite it.",
            True,
        )
    if records.nu == 1:
        sentence = (
            f"{records.input_names[0]} has a standard deviation of {spread[0]:.3g}."
        )
        return Finding("inputs", 0.0, sentence, False)
    correlation = np.corrcoef(records.u.T)
    pairs = np.abs(correlation) - np.eye(nu)
    i, j = np.unravel_index(np.argmax(pairs), pairs.shape)
    worst = float(pairs[i, j])
    a, b = records.input_names[min(i, j)], records.input_names[max(i, j)]
    sentence = f"The largest correlation of two inputs is {worst:.2f}, of {a} and {b}."
    # of each input with the sum of the others that is nearest to it
    values, vectors = np.linalg.eigh(correlation)
    inverse = np.sum(vectors**2 / np.maximum(values, np.finfo(float).eps), axis=1)
    sums = np.sqrt(np.maximum(0.0, 1.0 - 1.0 / inverse))
    if worst <= COLLINEAR < sums.max():
        worst = float(sums.max())
        one = records.input_names[np.argmax(sums)]
        sentence += f" With a sum of all others, that of {one} is {worst:.2f}."
    if worst > COLLINEAR:
        sentence += " Their effects cannot be told apart: move them independently."
    return Finding("inputs", worst, sentence, worst > COLLINEAR)
