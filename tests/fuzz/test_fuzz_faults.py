"""Signals, full disks and little memory: the command, small, in its own process."""

import subprocess
import sys
from pathlib import Path

import pytest

from fuzzing import SCALE

ROOT = Path(__file__).parents[2]


def run(module, *arguments):
    """Return what a command prints; it must find nothing."""
    command = [sys.executable, "-m", f"benchmarks.{module}", *map(str, arguments)]
    done = subprocess.run(command, cwd=ROOT, capture_output=True, text=True)
    assert done.returncode == 0, done.stdout + done.stderr
    return done.stdout.splitlines()


@pytest.mark.skipif(not sys.platform.startswith("linux"), reason="forks, and limits")
def test_signals_full_disks_and_little_memory_lose_nothing():
    lines = run("faults", "--kills", round(5 * SCALE))
    assert [line.split(":")[0] for line in lines] == [
        *("kill", "term", "disk", "memory", "injected")
    ]
