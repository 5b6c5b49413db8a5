"""Test errors as a constant of the package is halved and doubled.

    python -m benchmarks.constants {INITIAL_SLOPE,HORIZONS,WINDOW} [--cases NAME ...]
                                   [--model fl] [--seeds 2] [--set OPTION=VALUE ...]

The constants that no argument sets, on plants of the field benchmark whose fits take
seconds.  Prints the error of every test relative to that with the value of the
package, the median over the seeds; below them median and worst of all fits.  One
process, one thread.
"""

import argparse
import sys
from contextlib import contextmanager

import numpy as np

from alssnn import initial_states, starts, subspace

from .field.__main__ import CASES, assignment
from .field.runs import MODELS, Job, fit

SMALL = ("servo speed", "two tanks", "short", "short saturation")
LINEAR = (
    "servo speed",
    "two tanks",
    "dead zone",
    "saturation",
    "linear resonances",
    "short",
)
CONSTANTS = {
    "INITIAL_SLOPE": (starts, "fl", SMALL),
    "HORIZONS": (subspace, "lti", LINEAR),
    "WINDOW": (initial_states, "fl", SMALL),
}


@contextmanager
def changed(name, value):
    """Set a constant in every module that has it, for a while."""
    homes = [
        module
        for key, module in list(sys.modules.items())
        if key.partition(".")[0] == "alssnn" and hasattr(module, name)
    ]
    before = [getattr(module, name) for module in homes]
    for module in homes:
        setattr(module, name, value)
    try:
        yield
    finally:
        for module, old in zip(homes, before, strict=True):
            setattr(module, name, old)


def scaled(value, factor):
    """Return a constant times a factor: a number, or integers that stay integers."""
    if isinstance(value, tuple):
        return tuple(scaled(one, factor) for one in value)
    return type(value)(round(value * factor, 9))


def errors(cases, model, seeds, options):
    """Return the errors by (case, test), one per seed; inf where a fit crashed."""
    seeds = range(seeds) if "random_state" in MODELS[model]().get_params() else [0]
    found: dict[tuple, list] = {}
    for name in cases:
        for seed in seeds:
            for row in fit(Job(CASES[name], model, seed, options)):
                value = np.inf if row.get("error") else row["rmse"]
                found.setdefault((name, row["test"]), []).append(value)
    return {key: np.array(values) for key, values in found.items()}


def compare(constant, cases, model, seeds, options):
    """Return the values tried, and by value the errors relative to the package's."""
    home, *_ = CONSTANTS[constant]
    values = [scaled(getattr(home, constant), factor) for factor in (0.5, 1, 2)]
    found = []
    for value in values:
        with changed(constant, value):
            found.append(errors(cases, model, seeds, options))
    base = found[1]
    return values, [{key: each[key] / base[key] for key in base} for each in found]


def main(arguments=None):
    """Fit and print."""
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("constant", choices=CONSTANTS)
    parser.add_argument("--cases", nargs="+", choices=CASES)
    parser.add_argument("--model", choices=MODELS)
    parser.add_argument("--seeds", type=int, default=2)
    parser.add_argument("--set", type=assignment, nargs="+", default=[])
    args = parser.parse_args(arguments)
    _, model, cases = CONSTANTS[args.constant]
    model, cases = args.model or model, args.cases or cases
    values, found = compare(args.constant, cases, model, args.seeds, dict(args.set))
    print(f"{f'{args.constant}, {model}':30s}" + "".join(f"{v!s:>12s}" for v in values))
    every = [np.concatenate(list(each.values())) for each in found]
    rows = {" ".join(key): [np.median(each[key]) for each in found] for key in found[1]}
    rows["median"] = [np.median(one) for one in every]
    rows["worst"] = [np.max(one) for one in every]
    for name, row in rows.items():
        print(f"{name:30s}" + "".join(f"{value:12.3f}" for value in row))
    return 0


if __name__ == "__main__":
    sys.exit(main())
