"""What the fuzz tests share: how many cases, and what may be said of a refusal."""

import re
import traceback
import warnings
from contextlib import contextmanager

from hypothesis import HealthCheck, Phase, settings

SCALE = settings.default.max_examples / 100  # 1 in CI, 25 at night


def cases(n):
    """Return the settings of a test with n cases in CI."""
    return settings(
        max_examples=round(SCALE * n),
        phases=set(Phase) - {Phase.explain},
        suppress_health_check=[HealthCheck.too_slow, HealthCheck.data_too_large],
    )


@contextmanager
def only_warnings_for_users():
    """Let every warning be an error, but those that are meant for the user: a list."""
    with warnings.catch_warnings(record=True) as said:
        warnings.simplefilter("error")
        warnings.simplefilter("always", UserWarning)
        warnings.filterwarnings("ignore", "The simulation diverges", RuntimeWarning)
        yield said


def check_refusal(error):
    """Assert that a refusal names an argument, or is scikit-learn's own."""
    assert isinstance(error, ValueError | TypeError), repr(error)
    message = str(error)
    where = traceback.extract_tb(error.__traceback__)[-1].filename
    if "sklearn" in where.replace("\\", "/").split("/"):
        return
    assert len(message) < 1_000, message[:1_000]
    assert re.search(r"`\w+", message), repr(error)
