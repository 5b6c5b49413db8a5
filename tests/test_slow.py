"""The list of slow tests names tests that there are."""

import re
from functools import cache
from pathlib import Path

ROOT = Path(__file__).parents[1]
LINES = (ROOT / "tests" / "slow.txt").read_text(encoding="utf-8").splitlines()
NAMES = [line for line in LINES if not line.startswith("#")]


def test_the_list_is_sorted_and_says_nothing_twice():
    assert sorted(set(NAMES)) == NAMES


def is_there(name):
    path, _, test = name.partition("::")
    function = re.split(r"[\[*]", test)[0].rpartition(".")[2]
    return function in defined(path) if function else bool(defined(path))


@cache
def defined(path):
    """Return the names of the functions and classes of a file, if there is one."""
    file = ROOT / path
    source = file.read_text(encoding="utf-8") if file.exists() else ""
    return set(re.findall(r"^(?:def|class) (\w+)", source, re.M))


def test_what_is_listed_is_a_test_or_an_example():
    assert len(NAMES) > 100
    assert not [name for name in NAMES if not is_there(name)]


def test_every_file_keeps_a_fast_test():
    """A file whose tests are all slow would leave its module to the full run alone."""
    for file in (ROOT / "tests").glob("test_*.py"):
        source = file.read_text(encoding="utf-8")
        marked = re.findall(r"@pytest\.mark\.slow\n(?:@.*\n)*def (\w+)", source)
        slow = {f"tests/{file.name}::{test}" for test in marked} | set(NAMES)
        tests = re.findall(r"^def (test_\w+)", source, re.M)
        assert {f"tests/{file.name}::{test}" for test in tests} - slow, file.name
