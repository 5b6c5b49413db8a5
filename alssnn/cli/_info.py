"""`alssnn info`: what a saved model is."""

import numpy as np

from ._record import add_model

HELP = "say what a saved model is"
DESCRIPTION = "Say what a saved model is: signals, sizes, accuracy, poles."
EPILOG = """\
Poles are those of the linear part (A, B, C); a pole in continuous time is per second,
one in discrete time is stable within the unit circle.

examples:
  alssnn info plant.npz
  alssnn info plant.npz --json
"""


def add(parser):
    """Add the options.

    Parameters
    ----------
    parser : argparse.ArgumentParser
        Parser of the command.
    """
    add_model(parser)


def run(args):
    """Run the command.

    Parameters
    ----------
    args : argparse.Namespace
        Arguments of the command.
    """
    from ..estimators import load
    from ..metrics import missed_percent
    from ..validation import column_names

    model = load(args.model)
    inputs, outputs = column_names(model)
    given = {int(i) for i in model.disturbances_}
    missed = missed_percent(model.train_score_)
    poles = np.linalg.eigvals(model.A_)
    args.result = {
        "file": args.model,
        "model": type(model).__name__,
        "inputs": [name for i, name in enumerate(inputs) if i not in given],
        "disturbances": [name for i, name in enumerate(inputs) if i in given],
        "outputs": outputs,
        "states": model.nx_,
        "sampling_time": model.dt,
        "time": model.time,
        "input_delay": model.input_delay_,
        "parameters": int(model.fitted_.free.sum()),
        "training_experiments": len(model.experiments_),
        "training_error_percent": missed,
        "trial_steps": model.n_iter_,
        "converged": model.converged_,
        "end_of_training": model.message_,
        "poles": poles,
        "u_offset": model.u_offset_,
        "y_offset": model.y_offset_,
        "options": {
            name: value
            for name, value in model.get_params(deep=False).items()
            if isinstance(value, str | bool | int | float)
        },
    }
    known = args.result
    rows = [
        ("model", known["model"]),
        ("inputs", ", ".join(known["inputs"])),
        ("disturbances", ", ".join(known["disturbances"])),
        ("outputs", ", ".join(outputs)),
        ("states", f"{model.nx_}"),
        ("sampling time", f"{model.dt:.10g} s"),
        ("time", f"{model.time}{_went_on(model)}"),
        ("input delay", _delays(model, inputs)),
        ("parameters", f"{known['parameters']}, trained"),
        ("training error", _error(missed, model.drift)),
        ("training", f"{model.n_iter_} trial steps: {model.message_}"),
        ("poles", ", ".join(_pole(pole) for pole in poles) + _per_second(model)),
        ("operating point", _point(inputs, model.u_offset_, outputs, model.y_offset_)),
    ]
    rows = [(name, value) for name, value in rows if value]
    width = max(len(name) for name, _ in rows)
    print("\n".join(f"{name:{width}}  {value}" for name, value in rows))


def _error(missed, drift):
    """Return the training error; nothing if no process had all of the record."""
    from ..shown import percent

    knows = "" if drift is None else " without knowing what drifts"
    said = f"{percent(missed, 3)} of the output, simulated{knows}"
    return said if np.isfinite(missed) else ""


def _went_on(model):
    """Return what inputs did between the samples of the record, if not held."""
    if model.time != "continuous" or model.hold == "zoh":
        return ""
    return f', hold="{model.hold}" in the record; loops and exports hold u'


def _delays(model, inputs):
    """Return the inputs that are late, with their samples."""
    return ", ".join(
        f"{name} {count} sample{'s' if count > 1 else ''}"
        for name, count in zip(inputs, model.input_delay_.tolist(), strict=True)
        if count
    )


def _pole(pole):
    """Return a pole as text."""
    if pole.imag == 0:
        return f"{pole.real:.4g}"
    return f"{pole.real:.4g}{pole.imag:+.4g}j"


def _per_second(model):
    """Return the unit of poles, which those from sample to sample do not have."""
    return " per second" if model.time == "continuous" else ""


def _point(inputs, u, outputs, y):
    """Return the operating point by the names of its signals."""
    return ", ".join(
        f"{name} {value:.4g}"
        for name, value in zip([*inputs, *outputs], [*u, *y], strict=True)
    )
