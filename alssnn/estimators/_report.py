"""What is known of a fitted model, on one page: the report as a method."""

from sklearn.utils.validation import check_is_fitted

from ._fitted import Fitted


class ReportMixin(Fitted):
    """Share the report of fitted models."""

    def report(self, path, u, y, experiment=None, *, train=None):
        """Write one self-contained HTML page about the model.

        It has the equations with their numbers, accuracy, validation, linearizability,
        certificates, and a proposal for a controller, with figures. It needs no
        network, and what cannot be computed is said with its reason.

        Parameters
        ----------
        path : str or path-like
            File, by custom ``.html``; one that exists is replaced.
        u : array_like of shape (N, nu), or list of them
            Inputs of a record that the model was not trained on.
        y : array_like of shape (N,) or (N, ny), or list of them
            Outputs; nan where not measured.
        experiment : array_like of shape (N,) or None, default=None
            Label of the experiment of every sample.
        train : tuple, Record or None, default=None
            Training data, (u, y) or (u, y, experiment), to put their accuracy beside;
            None leaves it out.

        Raises
        ------
        NotFittedError
            If the model is not fitted.
        OSError
            If the file cannot be written.
        ValueError
            If the data do not fit the model.

        See Also
        --------
        validate : The checks alone.

        Notes
        -----
        Costs about a dozen simulations of the record and one semidefinite program.
        """
        from ..report import write_report

        check_is_fitted(self)
        write_report(self, path, u, y, experiment, train=train)
