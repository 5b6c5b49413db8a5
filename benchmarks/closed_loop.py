"""True plants in closed loop: is the designed linear response the one that comes out?

    python -m benchmarks.closed_loop [--plant ...] [--seeds 10] [--quick] [--all]
    python -m benchmarks.closed_loop --defaults [--plant ...] [--seeds 10] [--quick]

From a noisy record of every plant a model is identified, a linear-quadratic regulator
with integrators is designed on (A, B, C), and the true plant is run with it, with law
and observer.  The distance is the root mean square of the true output minus that of the
designed linear loop, for a staircase of references and without measurement noise.  The
competitor is the same design, with the same weights, on a linear model of the same
record.  Prints both distances and their ratio for every seed, and the medians.  Models
are set by hand; --all adds others, --defaults takes the defaults of all instead.
Without --quick it writes the table, and of models by hand the figure, to
doc/benchmarks.  Exits with 1 if the median ratio of pendulum or Duffing exceeds 1/8,
of models by hand; there is no such target for the defaults.
"""

import argparse
import os
import sys
import time
import warnings
from dataclasses import dataclass, field, replace

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

import control
import numpy as np
from sklearn.base import clone
from sklearn.exceptions import ConvergenceWarning

import alssnn
from alssnn import AlSsnn, FlSsnn, LinearStateSpace
from alssnn.datasets import Record, make_duffing, make_pendulum, make_prey_predator
from alssnn.feedback import closed_loop, designed_loop, lqi
from benchmarks._options import by_hand
from benchmarks._tables import OUT, machine, replace_runs

TARGET = 1 / 8
COLUMNS = ("plant", "model", "seed", "law", "lti", "ratio", "radius")
SAMPLES = 4_000  # of a record
SETTLE = 300  # samples, before the first step of a loop that does not start at rest

FEED = (1.0, 7.0)  # feed rates of the preys, least and largest
FEED_HOLD = (10, 100)  # samples
FEED_DT = 0.2  # s


@dataclass(frozen=True)
class Setting:
    """Say how a plant is recorded, modelled and controlled; the same for all seeds."""

    record: object  # seed -> Record
    models: dict  # name -> estimator; the first is the chosen one
    linear: object
    reference: float  # largest deviation of the reference, in units of y
    hold: int  # samples between two steps of the reference
    n_steps: int
    weight_z: float  # of the integrators; that of y is 1
    weight_v: float
    target: float = np.inf
    settle: int = 0  # samples at rest before the first step, not counted
    limits: dict = field(default_factory=dict)  # of the actuators


def matched(dt):
    """Return linear model and models of an oscillator, the chosen one first."""
    common = {"nx": 2, "dt": dt, "operating_point": "zero"}
    net = {"n_h": 8, "random_state": 0, **common}
    residual = {"n_g": 2, "gamma": 1.0, "penalty": "output"}
    models = {
        "FL-SSNN, h(x)": by_hand(FlSsnn, feedback="state", gamma_h=1e-4, **net),
        "FL-SSNN, h(x), gamma_h=0": by_hand(FlSsnn, feedback="state", **net),
        "FL-SSNN, h(y)": by_hand(FlSsnn, gamma_h=1e-4, **net),
        "FL-SSNN, h(y), gamma_h=0": by_hand(FlSsnn, **net),
        "AL-SSNN, h(x)": by_hand(
            AlSsnn, feedback="state", gamma_h=1e-4, **residual, **net
        ),
        "AL-SSNN, h(y)": by_hand(AlSsnn, gamma_h=1e-4, **residual, **net),
    }
    return {"models": models, "linear": LinearStateSpace(**common)}


def populations():
    """Return linear model and models of prey and predator."""
    common = {"nx": 3, "dt": FEED_DT}
    net = {"n_h": 8, "gamma_h": 1e-3, "random_state": 0, "max_iter": 150, **common}
    residual = {"n_g": 4, "gamma": 1.0, "penalty": "output"}
    models = {
        # exactly linearizable on paper only, yet nearest to its design
        "FL-SSNN, h(x)": by_hand(FlSsnn, feedback="state", **net),
        "AL-SSNN, h(x)": by_hand(AlSsnn, feedback="state", **residual, **net),
    }
    return {"models": models, "linear": LinearStateSpace(**common)}


def defaults(setting):
    """Return a setting with models of default options, in place of its own.

    Their operating point is the mean of the record, where the plants do not start.
    """
    common = {"dt": setting.linear.dt}
    models = {
        f"{cls.__name__[:2].upper()}-SSNN, defaults": cls(**common, random_state=0)
        for cls in (AlSsnn, FlSsnn)
    }
    own = {"models": models, "linear": LinearStateSpace(**common), "target": np.inf}
    return replace(setting, **own, settle=max(setting.settle, SETTLE))


def feed(seed):
    """Return a record of prey and predator, driven by feed rates w = u^2.

    The plant is even in u and has no linear part around u = 0: who controls it commands
    the rate, which cannot be negative.
    """
    rng = np.random.default_rng(seed)
    plant = make_prey_predator(2, dt=FEED_DT).plant

    def update(t, x, w, params):
        return plant.dynamics(t, x, np.sqrt(np.maximum(w, 0.0)))

    fed = control.nlsys(
        update,
        lambda t, x, w, params: x[2:],
        inputs=["w1", "w2"],
        outputs=["x3"],
        states=plant.state_labels,
        dt=FEED_DT,
    )
    n = SAMPLES + 200
    w = np.column_stack([stairs(n, FEED_HOLD, rng) for _ in range(2)])
    w = FEED[0] + (FEED[1] - FEED[0]) * (w + 1) / 2
    X = np.empty((n, 3))
    x = np.array([12.0, 12.0, 8.0])
    for k in range(n):
        X[k] = x
        x = fed.dynamics(k, x, w[k])
    X, w = X[200:], w[200:]  # the start has died out
    y = X[:, 2] + 0.01 * X[:, 2].std() * rng.standard_normal(len(X))
    return Record(w, y, FEED_DT, "fed prey and predator", fed, X[0])


def stairs(n, hold, rng):
    """Return levels within (-1, 1), held for a random number of samples."""
    levels = rng.uniform(-1, 1, n)
    return np.repeat(levels, rng.integers(*hold, n))[:n]


SETTINGS = {
    "pendulum": Setting(
        # 5 rad/s^2 can carry the arm over the top; make_pendulum refuses such records
        record=lambda seed: make_pendulum(
            SAMPLES, amplitude=5.0, noise=0.01, random_state=seed
        ),
        reference=1.3,
        hold=60,
        n_steps=10,
        weight_z=1e-2,
        weight_v=1e-3,
        target=TARGET,
        **matched(dt=0.05),
    ),
    "duffing": Setting(
        record=lambda seed: make_duffing(SAMPLES, noise=0.01, random_state=seed),
        reference=0.5,
        hold=60,
        n_steps=10,
        weight_z=1e-2,
        weight_v=1.0,
        target=TARGET,
        **matched(dt=0.4),
    ),
    "prey": Setting(
        record=feed,
        reference=2.0,
        hold=150,
        n_steps=8,
        weight_z=1e-3,
        weight_v=0.1,
        settle=300,
        limits={"u_min": 0.0},
        **populations(),
    ),
}


# -- one loop --------------------------------------------------------------------------


@dataclass(frozen=True)
class Run:
    """Hold the true and the designed response, the input v designed, the distance."""

    t: np.ndarray
    y: np.ndarray
    design: np.ndarray
    v: np.ndarray
    distance: float


def references(setting, seed, offset):
    """Return a staircase of references around the operating point, a row per output."""
    rng = np.random.default_rng(seed)
    size = len(offset), setting.n_steps
    steps = rng.uniform(-setting.reference, setting.reference, size)
    start = np.zeros((len(offset), setting.settle))
    return offset[:, None] + np.hstack([start, np.repeat(steps, setting.hold, axis=1)])


def follow(plant, model, K, r, x0, limits, d=None):
    """Run the true plant and the designed loop; return true y, designed y and v.

    Measured disturbances `d`, a row each, are given to both.
    """
    own = model.plant_
    d = np.empty((0, r.shape[1])) if d is None else d
    rest = np.concatenate([own.y_offset, own.d_offset])[:, None]
    r = np.vstack([r, d])
    r_model = r - rest
    t = times(plant, r)
    designed = control.forced_response(
        designed_loop(model, K), t, r_model, squeeze=False
    ).outputs
    law = model.linearizing_law(**limits)
    loop = closed_loop(plant, model, K, law=law)
    start = np.zeros(loop.nstates)
    start[: len(x0)] = x0  # the plant comes first
    true = control.input_output_response(loop, t, r, start, squeeze=False).outputs
    ny = own.ny
    design = designed[:ny] + model.y_offset_[:, None]
    return true[:ny], design, designed[ny:] + own.v_offset[:, None]


def times(plant, r):
    """Return the time of every sample of a reference."""
    return plant.dt * np.arange(r.shape[1])


def run(record, model, setting, seed, x0):
    """Design on the model, run the true plant, compare with the design."""
    C, nx, ny = model.C_, model.nx_, len(model.C_)
    Q = np.zeros((nx + ny, nx + ny))
    Q[:nx, :nx] = C.T @ C
    Q[nx:, nx:] = setting.weight_z * np.eye(ny)
    K = lqi(model, Q, setting.weight_v * np.eye(model.B_.shape[1]))
    r = references(setting, seed, model.y_offset_)
    true, designed, v = follow(record.plant, model, K, r, x0, setting.limits)
    y, design = true[0], designed[0]
    difference = (y - design)[setting.settle :]
    distance = float(np.sqrt(np.mean(difference**2)))
    t = times(record.plant, r)
    return Run(t, y, design, v[0], distance if np.isfinite(distance) else np.inf)


def attempt(record, model, setting, seed, x0):
    """Fit and run; return the run or None, what happened, and the spectral radius."""
    model = clone(model)
    if "random_state" in model.get_params():
        model.set_params(random_state=seed)
    model.fit(record.u, record.y)
    radius = float(np.abs(np.linalg.eigvals(model.A_)).max())
    try:
        result = run(record, model, setting, seed, x0)
    except (ValueError, RuntimeError) as error:  # no gain, or a loop that diverges
        return None, str(error).splitlines()[0], radius
    return result, "", radius


# -- table and figure ------------------------------------------------------------------


def compare(name, setting, seeds, with_all):
    """Print a row per seed and the medians; return rows of the table and a run."""
    models = list(setting.models.items())[: None if with_all else 1]
    ratios = {label: [] for label, _ in models}
    radii = {label: [] for label, _ in models}
    rows, shown = [], None
    print(f"{name:10s}{'model':26s}{'seed':>5s}{'law':>11s}{'LTI':>11s}{'ratio':>9s}")
    for seed in seeds:
        try:
            record = setting.record(seed)
        except ValueError as error:  # over the top
            print(f"{name:10s}seed {seed} has no record: {error}")
            continue
        # oscillators start at rest, the populations where the record ends
        x0 = np.zeros(record.plant.nstates)
        if setting.settle:
            x0 = record.x0
        linear, problem, _ = attempt(record, setting.linear, setting, seed, x0)
        if linear is None:
            print(f"{name:10s}seed {seed}: LTI {problem}")
            continue
        for label, model in models:
            result, problem, radius = attempt(record, model, setting, seed, x0)
            distance = np.inf if result is None else result.distance
            ratio = distance / linear.distance
            ratios[label].append(ratio)
            radii[label].append(radius)
            values = f"{distance:11.5f}{linear.distance:11.5f}{ratio:9.4f}"
            print(f"{name:10s}{label:26s}{seed:5d}{values} {problem}", flush=True)
            rows.append((name, label, seed, distance, linear.distance, ratio, radius))
            if shown is None and label == models[0][0]:
                shown = record, linear, result
    for label, values in ratios.items():
        unstable = sum(radius >= 1 for radius in radii[label])
        print(
            f"{name:10s}{label:26s} median ratio {np.median(values):.4f} = "
            f"1/{1 / np.median(values):.1f}, worst {max(values):.4f}, "
            f"unstable A in {unstable} of {len(values)}",
            flush=True,
        )
    return rows, shown, float(np.median(ratios[models[0][0]]))


def write_table(rows, load):
    """Write all runs as CSV, beside those of other plants, and medians as Markdown."""
    note = machine(load, alssnn, np, control)
    table = replace_runs(OUT / "closed_loop.csv", COLUMNS, rows, note, n_first=2)
    text = [
        "# True plants in closed loop",
        "",
        "By `python -m benchmarks.closed_loop --all`, and with `--defaults` in place",
        "of `--all`. Distance: root mean square of the true output minus that of the",
        "designed linear loop; LTI: that of the same design on a linear model of the",
        "same record; ratio: of the two, per seed.",
        "",
        "| plant | model | seeds | median distance | LTI | median ratio | worst ratio "
        "| unstable A |",
        "|---|---|---|---|---|---|---|---|",
    ]
    for plant, label in dict.fromkeys((row[0], row[1]) for row in table):
        part = np.array(
            [row[3:7] for row in table if row[:2] == [plant, label]], dtype=float
        )
        law, lti, ratio, _ = np.median(part, axis=0)
        text.append(
            f"| {plant} | {label} | {len(part)} | {law:.5f} | {lti:.5f} | "
            f"{ratio:.4f} | {part[:, 2].max():.4f} | {np.sum(part[:, 3] >= 1)} |"
        )
    text += ["", *(f"{note}." for note in dict.fromkeys(row[-1] for row in table))]
    (OUT / "closed_loop.md").write_text("\n".join(text) + "\n")


def draw(shown):
    """Draw reference, open loop, design and true loops of one seed per plant."""
    import matplotlib.pyplot as plt

    figure, axes = plt.subplots(
        2, len(shown), figsize=(5 * len(shown), 5), squeeze=False, layout="constrained"
    )
    for (top, bottom), (name, (record, linear, law)) in zip(
        axes.T, shown.items(), strict=True
    ):
        # the input of the linear loop, played to the plant without feedback
        x, y_open = np.zeros(record.plant.nstates), []
        for v in linear.v:
            y_open.append(record.plant.output(0, x, [v])[0])
            x = record.plant.dynamics(0, x, np.array([v]))
        top.plot(law.t, y_open, color="0.75", label="open loop")
        top.plot(law.t, linear.y, color="C3", label="true loop, linear model")
        top.plot(law.t, law.y, color="C0", label="true loop, with the law")
        top.plot(law.t, law.design, "k--", lw=1, label="its design")
        limit = 1.3 * np.abs(linear.y).max()  # the open loop may go over the top
        top.set(title=name, ylabel=record.plant.output_labels[0], ylim=(-limit, limit))
        for result, color in ((linear, "C3"), (law, "C0")):
            bottom.semilogy(law.t, np.abs(result.y - result.design), color, lw=1)
        bottom.set(xlabel="time, s", ylabel="distance from its design", ylim=(1e-6, 1))
    axes[0, 0].legend(fontsize="small")
    OUT.mkdir(parents=True, exist_ok=True)
    figure.savefig(OUT / "closed_loop.png", dpi=80)  # small: it is in the repository


def main():
    """Run, print, write, and compare with the targets."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--plant", choices=SETTINGS, nargs="+", default=list(SETTINGS))
    parser.add_argument("--seeds", type=int, default=10)
    parser.add_argument("--quick", action="store_true", help="two seeds, no files")
    which = parser.add_mutually_exclusive_group()
    which.add_argument("--all", action="store_true", help="other models, too")
    which.add_argument("--defaults", action="store_true", help="default options")
    options = parser.parse_args()
    warnings.simplefilter("ignore", ConvergenceWarning)
    load, start = os.getloadavg()[0], time.perf_counter()
    rows, shown, missed = [], {}, False
    for name in options.plant:
        setting, seeds = SETTINGS[name], range(2 if options.quick else options.seeds)
        setting = defaults(setting) if options.defaults else setting
        with_all = options.all or options.defaults
        more, example, ratio = compare(name, setting, seeds, with_all)
        rows += more
        missed |= ratio > setting.target
        if np.isfinite(setting.target):
            shown[name] = example
    print(f"{time.perf_counter() - start:.0f} s; target of the median: 1/8")
    if not options.quick:
        write_table(rows, load)
        if shown:
            draw(shown)
    return int(missed)


if __name__ == "__main__":
    sys.exit(main())
