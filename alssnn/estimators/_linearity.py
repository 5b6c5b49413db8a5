"""How linear a model is, and its Lur'e form in the user's units."""

import numpy as np
from sklearn.utils.validation import check_is_fitted

from ..linearizability import measure
from ..lure import Lure
from ..networks import Perceptron
from ..plant import Plant, signal_names
from ._fitted import Fitted


class LinearityMixin(Fitted):
    """Measure what the law u = v - h leaves nonlinear."""

    def linearizability(self, u, y, experiment=None):
        """Measure how linear the model is once h is cancelled.

        Parameters
        ----------
        u : array_like of shape (N, nu)
            Inputs.
        y : array_like of shape (N,) or (N, ny)
            Outputs; they set the initial states and the size of the output.
        experiment : array_like of shape (N,) or None, default=None
            Label of the experiment of every sample.

        Returns
        -------
        record : Linearizability
            The output-referred linearization error (eq. gauge), in all and in
            frequency bands, the paper's ratios, both of the model and of the closed
            loop u = v - h with the recorded input as v, the gains of A, and the share
            of samples outside the region of the training data. It prints as a table.

        Notes
        -----
        The initial state of every experiment is estimated from its first
        `n_init_samples` samples (at most a quarter of it), which are measured as well.
        Costs four simulations.
        """
        check_is_fitted(self)
        u, y, parts = self._test_data(u, y, experiment)
        lure, feedback = self._plant()
        experiments = [
            (
                u_s[:] * self._scaling.u_scale,
                y_s[:] * self._scaling.y_scale,
                self._initial_state(u_s, y_s, self._window(u_s)),
            )
            for u_s, y_s in self._experiments(u, y, parts)
        ]
        return measure(
            lure,
            (self.A_, self.B_, self.C_, self.D_),
            feedback,
            experiments,
            dt=self.dt,
            region=self._region,
            output_names=self.output_names_,
        )

    @property
    def plant_(self):
        """The fitted model as an immutable value, in the user's units."""
        check_is_fitted(self)
        if self._made is None:
            self._made = self._make_plant()
        return self._made

    def _make_plant(self):
        structure, scaling = self._structure, self._scaling
        nx, nu, ny = (structure.sizes[axis] for axis in "xuy")
        lure, (K, k) = self._plant()
        v = np.zeros((nu, lure.Theta.shape[1]))
        v[:, nx : nx + nu] = np.eye(nu)
        v[:, nx + nu :] += np.column_stack([K, k])
        Theta = np.insert(lure.Theta, [nx + ny] * nu, v, axis=0)
        by_state = "W_s" in self.params_
        return Plant(
            form=Lure(Theta, nx, nu, lure.nw, lure.sigma),
            law_form=self._law_form(nx if by_state else ny, nu),
            feedback="state" if by_state else "output",
            u_offset=scaling.u_offset,
            y_offset=scaling.y_offset,
            u_scale=scaling.u_scale,
            y_scale=scaling.y_scale,
            x_scale=np.broadcast_to(self._x_scale, nx),
            dt=float(self.dt),
            inputs=signal_names(getattr(self, "feature_names_in_", None), "u", nu),
            outputs=signal_names(self.output_names_, "y", ny),
            name=type(self).__name__,
            delay=self.input_delay_,
            noise=self.cost_,
            region=getattr(self, "_region", None),
        )

    def _law_form(self, ns, nu):
        """Return v as a static map of [s; u]."""
        layers = [] if (net := self._h()) is None else net.layers
        sizes = [len(W) for W, _ in layers[:-1]]
        nw = sum(sizes)
        Theta = np.zeros((nu + nw, ns + nu + nw + 1))
        Theta[:nu, ns : ns + nu] = np.eye(nu)
        stops = np.cumsum([0, *sizes])
        for i, (W, b) in enumerate(layers):
            last = i == len(layers) - 1
            rows = slice(0, nu) if last else slice(nu + stops[i], nu + stops[i + 1])
            start = 0 if i == 0 else ns + nu + stops[i - 1]
            Theta[rows, start : start + W.shape[1]] = W
            Theta[rows, -1] = b
        sigma = (net.activation,) * nw if layers else ()
        return Lure(Theta, 0, ns + nu, nw, sigma)

    def _plant(self):
        """Return the Lur'e form with the states x alone, and (K, k) of h = K w + k.

        Both are in the user's units; the only channel is y.
        """
        structure, scaling = self._structure, self._scaling
        full = structure.lure(self._theta)
        nx, nu, nw = structure.n_x0, full.nu, full.nw
        neurons = slice(full.nx + full.nz, len(full.Theta))
        rows = np.r_[structure.rows["x"], structure.rows["y"], neurons]
        cols = np.r_[structure.cols["x"], slice(full.nx, full.Theta.shape[1])]
        Theta = full.Theta[np.ix_(rows, cols)]
        x_scale = np.broadcast_to(self._x_scale, nx)
        Theta[:, :nx] /= x_scale
        Theta[:nx] *= x_scale[:, None]
        Theta[:, nx : nx + nu] /= scaling.u_scale
        Theta[nx : nx + len(self.C_)] *= scaling.y_scale[:, None]
        K, k = np.zeros((nu, nw)), np.zeros(nu)
        if "W_h" in self.params_:
            _, axis = structure.parameters["W_h"]
            first = structure.cols["u"].stop
            where = structure.cols[axis]
            K[:, where.start - first : where.stop - first] = self.params_["W_h"]
            k = self.params_.get("b_h", k)
        return Lure(Theta, nx, nu, nw, full.sigma), (K, k)

    def _h(self):
        """Return the network h in the user's units, None for a model without one."""
        if "W_h" not in self.params_:
            return None
        axis = self._structure.parameters["W_h"][1]
        return Perceptron.h(self.params_, self._structure.activations[axis])
