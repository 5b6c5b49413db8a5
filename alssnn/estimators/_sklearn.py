"""What scikit-learn asks of an estimator beside `fit`, `predict` and `score`."""

from functools import cache
from importlib import metadata


def with_tags(tags):
    """Return the tags of a regressor as those of a dynamical system.

    Parameters
    ----------
    tags : sklearn.utils.Tags
        Tags of a regressor.

    Returns
    -------
    tags : sklearn.utils.Tags
        The same object.
    """
    tags.target_tags.multi_output = True
    # a strictly proper dynamical system cannot fit shuffled static data
    tags.regressor_tags.poor_score = True
    tags.non_deterministic = False
    return tags


def manual_page(name):
    """Return the page of a class in the manual.

    Parameters
    ----------
    name : str
        Name of the class.

    Returns
    -------
    address : str
        Its address; empty unless the package names a manual.
    """
    manual = manual_url()
    return f"{manual}/generated/alssnn.{name}.html" if manual else ""


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
