"""How linear a model is, and its Lur'e form in the user's units."""

import numpy as np

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
        records = self.prepare_records(u, y, experiment)
        return measure(self.plant_, records, output_names=self.output_names_)

    def _make_plant(self):
        scaling, ny = self._scaling, len(self.C_)
        nx, nu = self.B_.shape
        by_state = "W_s" in self.params_
        return Plant(
            form=self._form(),
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

    def _form(self):
        """Return the Lur'e form of the states x alone, with the channels [y; v]."""
        structure, scaling = self._structure, self._scaling
        full = structure.lure(self._theta)
        nx, nu, ny = structure.n_x0, full.nu, len(self.C_)
        neurons = slice(full.nx + full.nz, len(full.Theta))
        rows = np.r_[structure.rows["x"], structure.rows["y"], neurons]
        cols = np.r_[structure.cols["x"], slice(full.nx, full.Theta.shape[1])]
        Theta = full.Theta[np.ix_(rows, cols)]
        x_scale = np.broadcast_to(self._x_scale, nx)
        Theta[:, :nx] /= x_scale
        Theta[:nx] *= x_scale[:, None]
        Theta[:, nx : nx + nu] /= scaling.u_scale
        Theta[nx : nx + ny] *= scaling.y_scale[:, None]
        v = np.zeros((nu, Theta.shape[1]))
        v[:, nx : nx + nu] = np.eye(nu)
        if "W_h" in self.params_:
            where = structure.cols[structure.parameters["W_h"][1]]
            late = full.nx - nx  # columns of further states, which stand before
            v[:, where.start - late : where.stop - late] = self.params_["W_h"]
            v[:, -1] = self.params_.get("b_h", 0.0)
        Theta = np.insert(Theta, [nx + ny] * nu, v, axis=0)
        return Lure(Theta, nx, nu, full.nw, full.sigma)

    def _law_form(self, ns, nu):
        """Return v as a static map of [s; u]."""
        layers = []
        if "W_h" in self.params_:
            activation = self._structure.activations[
                self._structure.parameters["W_h"][1]
            ]
            layers = Perceptron.h(self.params_, activation).layers
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
        sigma = (activation,) * nw if layers else ()
        return Lure(Theta, 0, ns + nu, nw, sigma)
