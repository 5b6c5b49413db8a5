"""What kills processes that work for a fit: a module that is quickly imported there."""

import os
import time


def dies(i, home, flag):
    """Return i, but kill the first process that is not home with a later task."""
    if i == 2 and os.getpid() != home:
        while not flag.exists():  # until another task is finished
            time.sleep(0.01)
        os._exit(1)
    flag.touch()
    return i
