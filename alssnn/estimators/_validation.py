"""Whether a fitted model deserves trust on a record: the checks, as one method."""

from ._fitted import Fitted


class ValidationMixin(Fitted):
    """Share the validation of fitted models."""

    def validate(self, u, y, experiment=None, **options):
        """Check the model on a record that it was not trained on.

        Parameters
        ----------
        u : array_like of shape (N, nu), or list of them
            Inputs.
        y : array_like of shape (N,) or (N, ny), or list of them
            Outputs; nan where not measured.
        experiment : array_like of shape (N,) or None, default=None
            Label of the experiment of every sample.
        **options : dict
            Level of the tests and other options of `validation.validate`, such as
            ``n_lags``.

        Returns
        -------
        validation : Validation
            Pass or fail, a number and a sentence each: independence of the residual
            from u, from squares and from cubes (eq. residuals), whiteness, fit of the
            free run and of predictions, extrapolation, linearizability. It prints as
            a table.

        Raises
        ------
        ValueError
            If an option is out of range or the record is too short for the lags.
        """
        from ..validation import validate

        return validate(self, u, y, experiment, **options)
