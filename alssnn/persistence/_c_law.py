"""The law u = phi^-1(v, s) in C: the parts of phi, in sizes of u.

What phi has of s alone, and what its neurons see of s, is computed once per sample.
The solution for u evaluates nothing but the neurons that see u, with their derivatives
(eq. inverse).
"""

from ..lure import Lure
from ..walk import static_map
from ._c_map import neuron_and_slope


class Inverse:
    """Hold the parts of phi = z(s) + D u + W sigma(a(s) + U u).

    Parameters
    ----------
    plant : Plant
        The model, whose law is solved for u.
    """

    def __init__(self, plant):
        before, behind = plant.solved_map.parts()
        nu, scale = plant.nv, plant.v_scale
        Theta = before.Theta.copy()
        Theta[:nu] /= scale[:, None]
        self.nu, self.n_inner, self.sigma = nu, behind.nw, behind.sigma
        self.layers = behind.layers
        self.of_s = Lure(Theta, 0, before.nu, before.nw, before.sigma)
        self.D = behind.M[:, -nu:].diagonal()
        self.U, self.W = behind.V[:, -nu:] * scale, behind.W / scale[:, None]

    def arrays(self):
        """Return the constants that depend on u.

        Returns
        -------
        arrays : dict of str to ndarray
            The constants by their names in C, without numbers where no neuron sees u.
        """
        return {"phi_D": self.D, "phi_U": self.U, "phi_W": self.W}

    def maps(self):
        """Return what depends on s alone.

        Returns
        -------
        maps : dict of str to tuple
            Comment, static map and inputs of every value.
        """
        inputs, nu = {"s": self.of_s.nu}, self.nu
        maps = {"z": ("what v has of s alone, in sizes of u", slice(nu), inputs)}
        if self.n_inner:
            rows = slice(nu, nu + self.n_inner)
            maps["a"] = "what the neurons that see u see of s", rows, inputs
        return {
            value: (comment, static_map(self.of_s, rows), inputs)
            for value, (comment, rows, inputs) in maps.items()
        }

    def response(self, numbers):
        """Return the statements that turn what neurons see into w and its derivative.

        Parameters
        ----------
        numbers : Numbers
            Type of all numbers.

        Returns
        -------
        response : str
            Lines of C.
        """
        return "\n".join(
            f"    {line}"
            for layer in self.layers
            for line in self._layer(layer, numbers)
        )

    def _layer(self, layer, numbers):
        sigma = self.sigma[layer.start]
        yield f"for (j = {layer.start}; j < {layer.stop}; j++) {{"
        yield from neuron_and_slope(sigma, numbers, "w[j]", "d[j]")
        yield "}"
