"""How linear a model is, and its Lur'e form in the user's units."""

import numpy as np

from ..linearizability import measure
from ..plant import Plant, forms, signal_names
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
        scaling, (nx, nu) = self._scaling, self.B_.shape
        return Plant(
            **forms(self._structure, self._theta, self._units()),
            u_offset=scaling.u_offset,
            y_offset=scaling.y_offset,
            u_scale=scaling.u_scale,
            y_scale=scaling.y_scale,
            x_scale=np.broadcast_to(self._x_scale, nx),
            dt=float(self.dt),
            inputs=signal_names(getattr(self, "feature_names_in_", None), "u", nu),
            outputs=signal_names(self.output_names_, "y", len(self.C_)),
            name=type(self).__name__,
            delay=self.input_delay_,
            noise=self.cost_,
            region=getattr(self, "_region", None),
        )
