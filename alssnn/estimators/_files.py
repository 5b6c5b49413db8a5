"""How a fitted model is kept and handed on: files, MATLAB, C, ONNX."""

from sklearn.utils.validation import check_is_fitted

from ._fitted import Fitted


class FilesMixin(Fitted):
    """Share the way from a fitted model to files.

    What does the work is imported when it is called.
    """

    def save(self, path):
        """Save the fitted model to one file, without pickle.

        Parameters
        ----------
        path : str or path-like
            File, by custom ``.npz``; one that exists is replaced.

        Raises
        ------
        NotFittedError
            If the model is not fitted.
        OSError
            If the file cannot be written.
        ValueError
            If the model has what no file can hold: an activation of your own, a
            `RandomState` as `random_state`, labels of experiments that are neither
            numbers nor strings, or values that are not finite.

        See Also
        --------
        alssnn.load : Load it.

        Notes
        -----
        A `linear_start` that is a model or a system is kept as its matrices
        and sampling time.
        """
        from ..persistence import save

        check_is_fitted(self)
        save(self, path)

    def to_mat(self, path, *, law=None, observer=None, gain=None):
        """Write the model, its law, observer and controller for MATLAB.

        The file has one struct ``model``: the linear part, the model and its law as
        Lur'e forms, operating point, scales, names, limits of the law, gains. All is
        in the units of the data, with vectors as columns.

        Parameters
        ----------
        path : str or path-like
            File, by custom ``.mat``; one that exists is replaced.
        law : LinearizingLaw or None, default=None
            Law, for example with limits; None takes `linearizing_law`, or leaves it
            out where it is ill-posed.
        observer : Observer, None or False, default=None
            Observer with constant gain; None takes `observer`, False leaves it out.
        gain : array_like of shape (nu, nx) or (nu, nx + ny) or None, default=None
            Gain of a controller as for `feedback.closed_loop`.

        Raises
        ------
        NotFittedError
            If the model is not fitted.
        OSError
            If the file cannot be written.
        TypeError
            If `law` or `observer` is of another type.
        ValueError
            If an argument does not fit the model, or an activation has no expression
            for MATLAB.
        """
        from ..persistence import to_mat

        to_mat(self, path, law=law, observer=observer, gain=gain)

    def to_c(
        self,
        directory,
        *,
        law=None,
        observer=None,
        gain=None,
        dtype="double",
        prefix="plant",
    ):
        """Write the model, its law, observer and controller as C sources.

        They are C99 with fixed sizes, allocate nothing and need `math.h` alone. A
        header, a source, a demonstration, a Makefile and a README with the order of
        the calls are written.

        Parameters
        ----------
        directory : str or path-like
            Folder, made if need be; files of the same names are replaced.
        law : LinearizingLaw or None, default=None
            Law, for example with limits; None takes `linearizing_law`, or leaves it
            out where it is ill-posed (then the README says why).
        observer : Observer, None or False, default=None
            Observer with constant gain; None takes `observer`, False leaves it out.
        gain : array_like of shape (nu, nx) or (nu, nx + ny) or None, default=None
            Gain of a controller as for `feedback.closed_loop`, from `feedback.lqr`,
            `place` or `lqi`. Integrators do not wind up at the limits of the law.
        dtype : {"double", "float"}, default="double"
            Type of all numbers.
        prefix : str, default="plant"
            Begins the names of files, functions and types.

        Returns
        -------
        paths : list of Path
            The files.

        Raises
        ------
        NotFittedError
            If the model is not fitted.
        OSError
            If a file cannot be written.
        TypeError
            If `law` or `observer` is of another type.
        ValueError
            If an argument does not fit the model, a value is beyond the range of
            `dtype`, an activation has no expression in C, or a controller is asked for
            where the law is ill-posed or y depends on u of the same sample.

        See Also
        --------
        to_nlsys : The same model for python-control.
        """
        from ..persistence import to_c

        return to_c(
            self,
            directory,
            law=law,
            observer=observer,
            gain=gain,
            dtype=dtype,
            prefix=prefix,
        )

    def to_onnx(self, directory, *, law=None, prefix="plant"):
        """Write one step of the model, and its law, as ONNX graphs.

        The step takes x and u to x_next and y, the law takes v and y, or x with state
        feedback, to u. All is in double precision and in the units of the data; every
        signal has the shape (N, n), with one row per plant. The past of late inputs
        stands behind the states. Names and sampling time are in the metadata.

        Parameters
        ----------
        directory : str or path-like
            Folder, made if need be; files of the same names are replaced.
        law : LinearizingLaw or None, default=None
            Law, for example with limits; None takes `linearizing_law`, or leaves it
            out where it is ill-posed (then the metadata say why).
        prefix : str, default="plant"
            Begins the names of the files.

        Returns
        -------
        paths : list of Path
            The files, ``plant_step.onnx`` and, where there is a law,
            ``plant_law.onnx``.

        Raises
        ------
        ImportError
            If onnx is not installed, the extra ``onnx``.
        NotFittedError
            If the model is not fitted.
        OSError
            If a file cannot be written.
        TypeError
            If `law` is of another type.
        ValueError
            If the law is of another model, `prefix` is no name, or an activation has
            no operator of ONNX.
        """
        from ..persistence import to_onnx

        return to_onnx(self, directory, law=law, prefix=prefix)
