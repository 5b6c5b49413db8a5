"""How linear a model is, and its Lur'e form in the user's units."""

import numpy as np
from sklearn.utils.validation import check_is_fitted

from ..linearizability import measure
from ..lure import Lure
from ..networks import Perceptron
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
