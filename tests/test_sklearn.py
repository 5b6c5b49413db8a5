import pytest
from sklearn.utils.estimator_checks import parametrize_with_checks

from alssnn import AlSsnn, FlSsnn, GrSsnn, LinearStateSpace

REASONS = {
    "check_methods_sample_order_invariance": "the samples of a dynamical system are "
    "ordered in time",
    "check_methods_subset_invariance": "a simulated sample depends on all before it",
    "check_fit1d": "a sequence of numbers is one signal in time",
}

ESTIMATORS = [
    LinearStateSpace(),
    FlSsnn(n_h=1, n_init=1, max_iter=2, integrators=0),
    # the searches are the same: the others go without, and with one order
    AlSsnn(2, n_h=2, n_g=2, n_init=1, alpha=1e-4, integrators=0, max_iter=3),
    GrSsnn(2, n_f=2, n_init=1, alpha=1e-4, integrators=0, max_iter=3),
]


@pytest.mark.filterwarnings("ignore::sklearn.exceptions.ConvergenceWarning")
@parametrize_with_checks(ESTIMATORS, expected_failed_checks=lambda _: REASONS)
def test_scikit_learn_checks(estimator, check):
    check(estimator)
