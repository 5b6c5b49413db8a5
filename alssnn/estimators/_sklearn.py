"""What scikit-learn asks of an estimator beside `fit`, `predict` and `score`."""

from functools import cache
from importlib import metadata
from typing import ClassVar

from sklearn.base import RegressorMixin
from sklearn.utils.metadata_routing import UNUSED


class ScikitLearnMixin(RegressorMixin):
    """Declare tags, default requests of metadata, and the link of the HTML display."""

    # labels go where records go, without set_fit_request by the user
    __metadata_request__fit: ClassVar[dict] = {"u": UNUSED, "experiment": True}
    __metadata_request__predict: ClassVar[dict] = {"u": UNUSED, "experiment": True}
    __metadata_request__score: ClassVar[dict] = {"u": UNUSED, "experiment": True}

    _doc_link_module = "alssnn"

    @property
    def _doc_link_template(self):
        """Page of the class in the manual; empty unless the package names a manual."""
        manual = manual_url()
        return f"{manual}/generated/alssnn.{type(self).__name__}.html" if manual else ""

    def __sklearn_tags__(self):
        """Return the tags."""
        tags = super().__sklearn_tags__()
        # a strictly proper dynamical system cannot fit shuffled static data
        tags.target_tags.multi_output = True
        tags.regressor_tags.poor_score = True
        tags.non_deterministic = False
        return tags


@cache
def manual_url():
    """Return the address that the installed package gives for its documentation.

    Returns
    -------
    url : str
        That of the project URL "Documentation", without a slash at the end; empty if
        there is none.
    """
    try:
        urls = metadata.metadata("alssnn").get_all("Project-URL") or []
    except metadata.PackageNotFoundError:  # a checkout that was never installed
        return ""
    named = dict(url.split(", ", 1) for url in urls if ", " in url)
    return named.get("Documentation", "").rstrip("/")
