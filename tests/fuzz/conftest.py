"""Profiles: `ci`, the default, and `nightly`, 25 times as many cases."""

from hypothesis import settings

settings.register_profile("ci", max_examples=100, derandomize=True, deadline=None)
settings.register_profile("nightly", max_examples=2_500, deadline=None)


def pytest_configure(config):
    if not config.getoption("--hypothesis-profile", default=None):
        settings.load_profile("ci")
