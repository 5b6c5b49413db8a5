"""Test errors as a constant of the package is halved and doubled.

    python -m benchmarks.constants {INITIAL_SLOPE,INITIAL_ROOTS,LONGER_STAGES,...}
                                   [--cases NAME ...] [--model fl] [--seeds 2]
                                   [--set OPTION=VALUE ...]

The constants that no argument sets, on plants of the field benchmark whose fits take
seconds; those of a monotone input map on the plants of `benchmarks.true_loops`, whose
fits take half a minute.  Instead of half and double, the decays of a monotone map, of
GR-SSNN and of the second path of AL-SSNN are compared with those of all other models,
and so is how many paths of AL-SSNN go on before one is chosen.  Instead of the
disagreement of starts that makes it compare orders along both kinds of its paths, none
does.
Prints the error of every test relative to that with the value of the package, the
median over the seeds; below them median and worst of all fits.  One process, one
thread.
"""

import argparse
import sys
from contextlib import contextmanager
from dataclasses import replace
from functools import partial

import numpy as np

from alssnn.descent import ALPHAS, FADING, SMOOTH, USUAL

from .field.__main__ import CASES as FIELD
from .field.__main__ import assignment
from .field.case import Case, Data
from .field.runs import MODELS, Job, fit
from .true_loops import CASES as PLANTS
from .true_loops import NOISE

SMALL = ("servo speed", "two tanks", "short", "short saturation")
LINEAR = (
    "servo speed",
    "two tanks",
    "dead zone",
    "saturation",
    "linear resonances",
    "short",
)
ACTUATORS = ("fan loop", "valve loop", "exchanger loop")
FREE = (
    "servo position",
    "servo speed",
    "robot joint",
    "two tanks",
    "dead zone",
    "short",
)
TWICE = ("levitation", "saturating motor", "Duffing", "two tanks", "short", "prey")
RIVALS = (
    "four tanks",
    "overflowing tank",
    "servo speed",
    "ball on beam",
    "short saturation",
)
DISAGREE = ("suspension", "trolley", "collector")
CONSTANTS = {
    "AGREE": ("al", DISAGREE),
    "FADING": ("al", TWICE),
    "DECAYS": ("fl", (*ACTUATORS, "levitation loop", "arm loop")),
    "INITIAL_SLOPE": ("fl", SMALL),
    "INITIAL_ROOTS": ("fl", ACTUATORS),
    "LONGER_STAGES": ("fl", ACTUATORS),
    "HORIZONS": ("lti", LINEAR),
    "RIVALLING": ("al", RIVALS),
    "SMOOTH": ("gr", FREE),
    "WINDOW": ("fl", SMALL),
}
# what is tried instead of half and double
OTHERS = {
    "AGREE": [np.inf],
    "DECAYS": [tuple(ALPHAS)],
    "SMOOTH": [USUAL, replace(SMOOTH, of_long=None)],
    "FADING": [USUAL, replace(FADING, of_long=None)],
    "RIVALLING": [USUAL],
}


def recorded(loop):
    """Return a noisy record of a plant, and one without noise."""
    record = loop.make(loop.samples, noise=NOISE, random_state=0)
    fresh = loop.make(loop.samples, random_state=1)
    return Data([(record.u, record.y)], {"fresh": [(fresh.u, fresh.y)]}, record.dt)


def mapped(loop):
    """Return the options with which a plant of `true_loops` is modelled."""
    options = {"nx": loop.nx, "feedback": loop.feedback, "input_map": "monotone"}
    if loop.disturbances:
        options["disturbances"] = loop.disturbances
    return options


# some names are also of the field
LOOPS = {f"{name} loop": loop for name, loop in PLANTS.items()}
CASES = FIELD | {
    name: Case(name, "actuator", partial(recorded, loop), "seen")
    for name, loop in LOOPS.items()
}
# what their models are told beside the defaults
OPTIONS = {name: mapped(loop) for name, loop in LOOPS.items()}


def homes(name):
    """Return the modules of the package that have a constant."""
    return [
        module
        for key, module in list(sys.modules.items())
        if key.partition(".")[0] == "alssnn" and hasattr(module, name)
    ]


@contextmanager
def changed(name, value):
    """Set a constant in every module that has it, for a while."""
    changing = homes(name)
    before = [getattr(module, name) for module in changing]
    for module in changing:
        setattr(module, name, value)
    try:
        yield
    finally:
        for module, old in zip(changing, before, strict=True):
            setattr(module, name, old)


def scaled(value, factor):
    """Return a constant times a factor: a number, or integers that stay integers."""
    if isinstance(value, tuple):
        return tuple(scaled(one, factor) for one in value)
    return type(value)(round(value * factor, 9))


def name_of(value):
    """Return a number, a few of them, or the first and the last of many."""
    finalists, long = getattr(value, "finalists", 1), getattr(value, "of_long", None)
    value = getattr(value, "alphas", value)
    if isinstance(value, tuple) and len(value) > 3:
        value = f"{value[0]:g}..{value[-1]:g}"
    value = f"{value}, long {len(long.alphas)}" if long else value
    return f"{value}, {finalists} finalists" if finalists > 1 else str(value)


def errors(cases, model, seeds, options):
    """Return the errors by (case, test), one per seed; inf where a fit crashed."""
    seeds = range(seeds) if "random_state" in MODELS[model]().get_params() else [0]
    found: dict[tuple, list] = {}
    for name in cases:
        for seed in seeds:
            told = OPTIONS.get(name, {}) | options
            for row in fit(Job(CASES[name], model, seed, told)):
                value = np.inf if row.get("error") else row["rmse"]
                found.setdefault((name, row["test"]), []).append(value)
    return {key: np.array(values) for key, values in found.items()}


def compare(constant, cases, model, seeds, options):
    """Return the values tried, and by value the errors relative to the package's."""
    value = getattr(homes(constant)[0], constant)
    if constant in OTHERS:
        values = [*OTHERS[constant], value]
    else:
        values = [scaled(value, 0.5), value, scaled(value, 2)]
    found = []
    for tried in values:
        with changed(constant, tried):
            found.append(errors(cases, model, seeds, options))
    base = found[values.index(value)]
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
    model, cases = CONSTANTS[args.constant]
    model, cases = args.model or model, args.cases or cases
    values, found = compare(args.constant, cases, model, args.seeds, dict(args.set))
    print(
        f"{f'{args.constant}, {model}':30s}"
        + "".join(f"{name_of(v):>28s}" for v in values)
    )
    every = [np.concatenate(list(each.values())) for each in found]
    rows = {" ".join(key): [np.median(each[key]) for each in found] for key in found[1]}
    rows["median"] = [np.median(one) for one in every]
    rows["worst"] = [np.max(one) for one in every]
    for name, row in rows.items():
        print(f"{name:30s}" + "".join(f"{value:28.3f}" for value in row))
    return 0


if __name__ == "__main__":
    sys.exit(main())
