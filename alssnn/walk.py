"""One walk over the layers of a Lur'e form, for every language that is written.

A model step, an output and a law are static maps: a Lur'e form without states, from
stacked inputs to channels.  `walk` states such a map by two kinds of statements, block
by block of Theta (eq. lure), blocks of zeros left out:

    w_i = sigma(V_i [inputs] + E_i [w_1 .. w_(i-1)] + b_i)     for every layer i
    z   =       M   [inputs] + W   [w_1 .. w_n]     + c

and a writer puts them into its language.  No network is known by name, so that every
declared structure can be written.
"""

import numpy as np

from .lure import Lure


def static_map(form, rows, n_inputs=None):
    """Return rows of a Lur'e form as a static map, without neurons they do not need.

    Parameters
    ----------
    form : Lure
        The form.
    rows : slice
        Rows of x+ and z that are wanted.
    n_inputs : int or None, default=None
        Number of leading columns of [x; u] that are not zero; None means all.

    Returns
    -------
    lure : Lure
        The form without states, whose inputs are [x; u] and whose channels the rows.
    """
    first = form.nx + form.nu
    inputs = np.arange(first if n_inputs is None else n_inputs)
    needed = np.any(form.W[rows] != 0, axis=0)
    for j in reversed(range(form.nw)):  # E is strictly lower triangular
        if needed[j]:
            needed |= form.E[j] != 0
    neurons = np.flatnonzero(needed)
    wanted = np.r_[rows, form.nx + form.nz + neurons]
    Theta = form.Theta[np.ix_(wanted, np.r_[inputs, first + neurons, -1])]
    sigma = tuple(form.sigma[j] for j in neurons)
    return Lure(Theta, 0, len(inputs), len(neurons), sigma)


def walk(lure, inputs, writer, value):
    """State a static map by a writer.

    Parameters
    ----------
    lure : Lure
        Form without states, such as `static_map` returns.
    inputs : dict of str to int
        Signals that its inputs stack, and their sizes.
    writer : object
        ``affine(value, terms, constant)`` states ``value = sum of matrix @ signal +
        constant``, where terms are tuples (name, matrix, signal) and constant is (name,
        vector), and returns what the next statements call the value;
        ``activate(value, size, sigma)`` states ``value = sigma(value)`` likewise.
    value : str
        What the channels are called.

    Returns
    -------
    value : object
        What `writer` calls the channels.
    """
    stops = np.cumsum([0, *inputs.values()])
    signals = [
        (f"_{name}", name, slice(*ends))
        for name, *ends in zip(inputs, stops, stops[1:], strict=False)
    ]

    def affine(value, rows, linear, coupling, constant):
        terms = [
            (f"{linear if name in inputs else coupling}{end}", rows[:, columns], name)
            for end, name, columns in signals
            if np.any(rows[:, columns])
        ]
        return writer.affine(value, terms, (constant, rows[:, -1]))

    for i, layer in enumerate(lure.layers, start=1):
        w = affine(f"w{i}", lure.rows_v[layer], f"V{i}", f"E{i}_", f"b{i}")
        w = writer.activate(w, layer.stop - layer.start, lure.sigma[layer.start])
        start, stop = lure.nu + layer.start, lure.nu + layer.stop
        signals.append((str(i), w, slice(start, stop)))
    return affine(value, lure.rows_z, "M", "W", "c")
