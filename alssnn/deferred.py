"""Methods whose work is done, and described, by other packages."""

from importlib import import_module
from types import MethodType


class deferred:
    """Make a method of a function that is imported when it is first asked for.

    Identification needs neither python-control nor cvxpy nor matplotlib; what a user
    expects of a model, or of a controller, beyond it is one line, and one description
    over there. The function is asked for by its name, so that it may lie above.

    Parameters
    ----------
    module : str
        Module or package of alssnn, such as ``"feedback"``.
    name : str
        Name of a function or class there; its first argument is the object.
    """

    def __init__(self, module, name):
        self.module, self.name = module, name

    def __get__(self, model, owner=None):
        """Return the method of a model, or the function of the class."""
        function = getattr(import_module(f"alssnn.{self.module}"), self.name)
        return function if model is None else MethodType(function, model)
