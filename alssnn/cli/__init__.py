"""The command line: from a CSV file to a model, a report and a controller.

One module per command; `_arguments` has the options they share, `_record` what they
read.  Results go to the standard output, progress and errors to the standard error, so
that the result can be piped.  Exit codes: 0 done; 1 a check or the computation failed;
2 wrong usage or data; 130 interrupted.  What a user can get wrong ends in one line,
without a traceback.
"""

from ._main import main

__all__ = ["main"]
