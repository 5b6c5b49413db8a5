"""Models in continuous time: measured input, other rates, the sampled law, the cost.

    python -m benchmarks.continuous [--study untuned|silverbox|rates|law|step] [--quick]

untuned: defaults with nx=2 on four plants that nobody tuned for, inputs held, 1 % of
    noise, 1,500 samples, seeds 0, 1, 2: error on 1,500 fresh samples over std(y), and
    how many fits are worse than the linear model in continuous time by more than 2 %.
silverbox: defaults with ``time="continuous"`` and every hold on the record of the
    Silverbox (ALSSNN_DATA_HOME): error of simulation on its three tests, and the time.
rates: records without noise of a pendulum and a Duffing oscillator at four sampling
    times, each half of the one before; h is one neuron, a sine or a cube.  The poles
    about the operating point against the true ones, which no basis changes, and the
    order of convergence.  And records with 1 % of noise: the error of a model of 0.4 s
    (defaults, and two steps of Runge and Kutta) on a record of another sampling time,
    over that of a model that was fitted there.
law: the Duffing record of every 0.4 s, output feedback, in the true loop (LQ with
    integrators, as benchmarks.closed_loop) at the sampling times 0.4, 0.2 and 0.1 s,
    over the same design on a linear model.
step: a pass for (J'J, J'r) over that of the discrete model of the same networks, in one
    process by turns, one BLAS thread, medians.

Writes doc/benchmarks/continuous.md, the studies that were not run left as they are,
unless --quick.
"""

import argparse
import os
import time
import warnings

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

import control
import numpy as np

import alssnn
from alssnn.continuous import sampled, with_nodes
from alssnn.criterion import Criterion
from alssnn.datasets import fetch_silverbox, make_duffing
from alssnn.feedback import closed_loop, designed_loop, lqi
from alssnn.models import state_space
from alssnn.optimizers import single_threaded
from benchmarks._tables import OUT, machine

CUBE = alssnn.Activation(
    "cube", lambda v: v**3, lambda v, w: 3 * v**2, slope=(0, np.inf), odd=True
)
RATES = (0.4, 0.2, 0.1, 0.05)  # s
TIMES = "continuous", "discrete"
LAW_RATES = (0.4, 0.2, 0.1)
N_LAW = 4_000  # samples, as in benchmarks.closed_loop
TRUE = {"pendulum": (0.8, 4.0), "duffing": (0.4, 1.0)}  # damping and stiffness at rest
REFERENCE, HOLD, N_STEPS = 0.5, 24.0, 10  # of the loops: m, s, steps
WEIGHTS = 1e-2, 1.0  # of the integrators at 0.4 s, and of v


def silverbox(quick):
    """Yield rows: model, hold, errors in mV, seconds."""
    train, tests = fetch_silverbox()
    n = 6_000 if quick else len(train.u)
    cases = [
        ("LinearStateSpace", {"nx": 2}, "cubic"),
        ("FlSsnn", {"nx": 2}, "zoh"),
        ("FlSsnn", {"nx": 2}, "linear"),
        ("FlSsnn", {"nx": 2}, "cubic"),
        ("FlSsnn", {"nx": 2, "odd": True}, "cubic"),
        ("FlSsnn", {"nx": 2, "odd": True, "n_h": 5}, "cubic"),
        ("AlSsnn", {"nx": 3}, "cubic"),
        ("GrSsnn", {"nx": 3}, "cubic"),
    ]
    for name, options, hold in cases[:1] if quick else cases:
        start = time.perf_counter()
        if name != "LinearStateSpace":
            options = {**options, "random_state": 0}
        model = getattr(alssnn, name)(
            dt=train.dt, time="continuous", hold=hold, **options
        ).fit(train.u[:n], train.y[:n])
        seconds = time.perf_counter() - start
        errors = []
        for test in tests.values():
            y_true, y_pred = model.simulate_test(test.u, test.y)
            errors.append(f"{1e3 * np.sqrt(np.mean((y_true - y_pred) ** 2)):.3g}")
        options.pop("random_state", None)
        shown = ", ".join(f"{k}={v}" for k, v in options.items())
        yield f"{name}({shown})", hold, *errors, f"{seconds:.0f}"


def swinging(kind, dt, n, seed):
    """Return a record without noise, an input of random steps of 1.6 s."""
    damping, stiffness = TRUE[kind]
    rng = np.random.default_rng(seed)
    length = round(1.6 / dt)
    u = 0.6 * np.repeat(rng.uniform(-1, 1, n // length + 1), length)[:n]

    def f(x, u):
        spring = np.sin(x[0]) if kind == "pendulum" else x[0] + x[0] ** 3
        return np.array([x[1], stiffness * (u - spring) - damping * x[1]])

    return u[:, None], true_states(f, u, dt)[:, 0]


def true_states(f, u, dt, steps=40):
    """Return the states of x' = f(x, u) at the samples, u held."""
    x, X = np.zeros(2), []
    for value in u:
        X.append(x)
        x = step(f, x, value, dt, steps)
    return np.array(X)


def rates(quick):
    """Yield rows: plant, sampling time, error of the poles, order, ratios elsewhere."""
    n = 400 if quick else 1_000
    for kind in TRUE:
        before, coarse = None, {}
        for dt in RATES[:2] if quick else RATES:
            model = exact(kind, dt).fit(*swinging(kind, dt, n, 0))
            x, zero = np.zeros((1, 2)), np.zeros((1, 1))
            A, *_ = model.plant_.at(dt / 64).jacobian(x, zero)
            poles = np.log(np.linalg.eigvals(A[0]).astype(complex)) * 64 / dt
            true = np.roots([1.0, *TRUE[kind]])
            error = min(np.abs(poles - z).max() for z in (true, true[::-1]))
            order = "" if before is None else f"{np.log2(before / error):.1f}"
            before, ratios = error, []
            for substeps in (1, 2):
                default = alssnn.FlSsnn(
                    nx=2,
                    n_h=5,
                    feedback="output",
                    dt=dt,
                    time="continuous",
                    substeps=substeps,
                    random_state=0,
                )
                default.fit(*noisy(kind, dt, n, 0))
                if dt == RATES[0]:
                    coarse[substeps] = default
                    continue
                u, y = noisy(kind, dt, n, 1)
                own, other = (
                    np.sqrt(np.mean((y - predicted(one.plant_.at(dt), u)) ** 2))
                    for one in (default, coarse[substeps])
                )
                ratios.append(f"{other / own:.3f}")
            yield kind, f"{dt:g}", f"{error:.1e}", order, *(ratios or ["", ""])


def exact(kind, dt):
    """Return a model of the class that the plant is in."""
    return alssnn.FlSsnn(
        nx=2,
        n_h=1,
        odd=True,
        activation="sin" if kind == "pendulum" else CUBE,
        feedback="output",
        dt=dt,
        time="continuous",
        operating_point="zero",
        tol=1e-15,
        max_iter=300,
        n_init=3,
        random_state=0,
    )


def noisy(kind, dt, n, seed):
    """Return a record with 1 % of noise."""
    u, y = swinging(kind, dt, n, seed)
    return u, y + 0.01 * y.std() * np.random.default_rng(seed).standard_normal(n)


def predicted(plant, u):
    """Return the simulation of a plant from rest."""
    x, y = np.zeros((1, plant.nx)), []
    for row in u:
        y.append(plant.output(x, row[None])[0, 0])
        x = plant.step(x, row[None])
    return np.array(y)


def true_duffing(dt):
    """Return the Duffing oscillator of the record, sampled at another time."""

    def update(t, x, u, params):
        def f(x, u):
            return np.array([x[1], u - 0.1 * x[1] - x[0] - x[0] ** 3])

        return step(f, x, u[0], dt)

    return control.nlsys(
        update,
        lambda t, x, u, params: x[:1],
        inputs=["u"],
        outputs=["y"],
        states=["position", "velocity"],
        dt=dt,
        name="duffing",
    )


def step(f, x, u, dt, steps=8):
    """Return the state a sample later."""
    h = dt / steps
    for _ in range(steps):
        k1 = f(x, u)
        k2 = f(x + h / 2 * k1, u)
        k3 = f(x + h / 2 * k2, u)
        k4 = f(x + h * k3, u)
        x = x + h / 6 * (k1 + 2 * k2 + 2 * k3 + k4)
    return x


def loop_distance(plant, dt, seed):
    """Return the distance of the true loop from its design, m."""
    _, _, C, _ = plant.linear()
    Q = np.zeros((plant.nx + 1, plant.nx + 1))
    Q[:-1, :-1] = C.T @ C * dt
    Q[-1, -1] = WEIGHTS[0] * dt * (dt / 0.4) ** 2  # the sum grows with the rate
    K = lqi(plant, Q, WEIGHTS[1] * dt * np.eye(1))
    rng = np.random.default_rng(seed)
    r = np.repeat(rng.uniform(-REFERENCE, REFERENCE, N_STEPS), round(HOLD / dt))[None]
    t = dt * np.arange(r.shape[1])
    offset = plant.y_offset[:, None]
    designed = control.forced_response(
        designed_loop(plant, K), t, r - offset, squeeze=False
    ).outputs[:1]
    loop = closed_loop(true_duffing(dt), plant, K)
    true = control.input_output_response(
        loop, t, r, np.zeros(loop.nstates), squeeze=False
    ).outputs[:1]
    return float(np.sqrt(np.mean((true - designed - offset) ** 2)))


def law(quick):
    """Yield rows: model, sampling time of the law, distance, that of LTI, ratio."""
    seeds = range(1 if quick else 5)
    found = {}
    for seed in seeds:
        record = make_duffing(N_LAW, noise=0.01, random_state=seed)
        linear = alssnn.LinearStateSpace(nx=2, dt=record.dt, time="continuous").fit(
            record.u, record.y
        )
        options = {"nx": 2, "dt": record.dt, "feedback": "output"}
        models = {
            "continuous": alssnn.FlSsnn(
                time="continuous", random_state=seed, **options
            ),
            "continuous, gamma_h=1e-4": alssnn.FlSsnn(
                time="continuous", gamma_h=1e-4, random_state=seed, **options
            ),
            "discrete": alssnn.FlSsnn(random_state=seed, **options),
        }
        for name, model in models.items():
            model.fit(record.u, record.y)
            for dt in LAW_RATES[:1] if name == "discrete" else LAW_RATES:
                lti = loop_distance(linear.plant_.at(dt), dt, seed)
                for ahead in (False,) if name == "discrete" else (False, True):
                    try:
                        plant = model.plant_.at(dt, ahead=ahead)
                        own = loop_distance(plant, dt, seed)
                    except (ValueError, RuntimeError):
                        own = np.inf
                    row = name + ahead * ", law looks ahead", dt
                    found.setdefault(row, []).append((own, lti))
    for (name, dt), pairs in found.items():
        own, lti = np.array(pairs).T
        yield (
            f"FlSsnn, {name}",
            f"{dt:g}",
            f"{np.median(own):.2g}",
            f"{np.median(lti):.2g}",
            f"1/{1 / np.median(own / lti):.1f}",
            f"1/{1 / np.max(own / lti):.1f}",
        )


def two_tanks(x, u):
    """Return x' of two tanks in a row, inflow u."""
    flow = np.sqrt(np.maximum(x, 1e-6))
    return np.array([u - flow[0], flow[0] - flow[1]])


def van_der_pol(x, u):
    """Return x' of an oscillator whose damping grows with its position."""
    return np.array([x[1], u - x[0] - (0.3 + x[0] ** 2) * x[1]])


def fan_arm(x, u):
    """Return x' of an arm with a fan, whose thrust is u |u|."""
    return np.array([x[1], 3 * u * abs(u) - 4 * np.sin(x[0]) - 0.6 * x[1]])


def reactor(x, u):
    """Return x' of a stirred reactor, conversion and temperature, cooling u."""
    rate = 0.1 * (1 - x[0]) * np.exp(x[1] / (1 + x[1] / 20))
    return np.array([rate - x[0], 6.4 * rate - x[1] + 0.3 * (u - x[1])])


UNTUNED = {  # x', range of u, dt, first state, output
    "two tanks": (two_tanks, (0.5, 1.5), 0.3, (1.0, 1.0), 1),
    "van der Pol": (van_der_pol, (-1.5, 1.5), 0.2, (0.0, 0.0), 0),
    "fan arm": (fan_arm, (0.2, 0.9), 0.1, (0.5, 0.0), 0),
    "reactor": (reactor, (-1.0, 1.0), 0.15, (0.3, 1.0), 1),
}


def untuned(quick):
    """Yield rows: plant, model, errors of three seeds, continuous and discrete."""
    n = 300 if quick else 1_500
    models = ("LinearStateSpace", "FlSsnn", "AlSsnn", "GrSsnn")
    for kind, (f, limits, dt, x0, output) in UNTUNED.items():
        errors = {name: ([], []) for name in models}
        for seed in range(1 if quick else 3):
            rng = np.random.default_rng(seed)
            u = np.repeat(rng.uniform(*limits, 2 * n // 8), 8)
            y, x = [], np.array(x0)
            for value in u:
                y.append(x[output])
                x = step(f, x, value, dt)
            y = np.array(y) + 0.01 * np.std(y) * rng.standard_normal(len(u))
            u = u[:, None]
            for name in models[:1] if quick else models:
                options = {"nx": 2, "dt": dt}
                if name != models[0]:
                    options["random_state"] = seed
                for found, kind_of in zip(errors[name], TIMES, strict=True):
                    model = getattr(alssnn, name)(time=kind_of, **options)
                    model.fit(u[:n], y[:n])
                    found.append(np.sqrt(1 - model.score(u[n:], y[n:])))
        for name, pair in errors.items():
            shown = [" ".join(f"{100 * e:.2f}" for e in found) for found in pair]
            worse = (
                np.array(pair[0])
                > 1.02 * np.array(errors[models[0]][0])[: len(pair[0])]
            )
            yield kind, name, *shown, str(int(worse.sum()))


def steps_of_training(quick):
    """Yield rows: model, hold, substeps, pass over that of the discrete model."""
    rng = np.random.default_rng(0)
    n = 2_000 if quick else 10_000
    for name, networks, channels in (
        ("FL", {"n_h": 10, "feedback": "state"}, ("y",)),
        ("GR", {"n_g": 10}, ("y",)),
        ("AL", {"n_h": 10, "n_g": 10, "feedback": "state"}, ("y", "e")),
    ):
        C = np.eye(1, 4)
        structure = state_space(4, 1, 1, C=C, **networks)
        p = structure.split(0.1 * rng.standard_normal(structure.n_params))
        rate = -0.2 * np.eye(4) + 0.3 * (np.eye(4, k=1) - np.eye(4, k=-1))
        u, y = rng.standard_normal((2, n, 1))
        weights = dict.fromkeys(channels, 1.0)

        def criterion(structure, A, p=p, u=u, y=y, channels=channels, weights=weights):
            pairs = with_nodes(structure, [(u, y)])
            one = Criterion(structure.observe(*channels), pairs, weights=weights)
            return one, one.join(structure.join({**p, "A": A}), np.zeros((1, 4)))

        discrete = criterion(structure, np.eye(4) + rate)
        for hold, substeps in (("zoh", 1), ("cubic", 1), ("zoh", 2)):
            one = criterion(sampled(structure, hold, substeps), rate)
            ratios = []
            with single_threaded():
                for _ in range(3 if quick else 15):
                    spent = []
                    for problem, free in (discrete, one):
                        start = time.perf_counter()
                        problem.normal_equations(free)
                        spent.append(time.perf_counter() - start)
                    ratios.append(spent[1] / spent[0])
            yield name, hold, str(substeps), f"{np.median(ratios[1:]):.2f}"


STUDIES = {
    "untuned": (
        untuned,
        ("plant", "model", "continuous, %", "discrete, %", "worse than linear"),
    ),
    "silverbox": (
        silverbox,
        ("model", "hold", "multisine, mV", "arrow", "no extrapolation", "s"),
    ),
    "rates": (
        rates,
        ("plant", "dt, s", "error of poles", "order", "from 0.4 s", "with 2 substeps"),
    ),
    "law": (
        law,
        ("model", "dt of the law, s", "median distance", "LTI", "ratio", "worst"),
    ),
    "step": (steps_of_training, ("model", "hold", "substeps", "over discrete")),
}


def main():
    """Run the studies and write their tables."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--study", choices=STUDIES, action="append")
    parser.add_argument("--quick", action="store_true")
    args = parser.parse_args()
    warnings.simplefilter("ignore")
    path, load = OUT / "continuous.md", os.getloadavg()[0]
    for study in args.study or STUDIES:
        run, titles = STUDIES[study]
        lines = [f"| {' | '.join(titles)} |", "|---" * len(titles) + "|"]
        print(f"\n{study}\n" + "\n".join(lines), flush=True)
        for row in run(args.quick):
            lines.append(f"| {' | '.join(row)} |")
            print(lines[-1], flush=True)
        if not args.quick:
            keep(path, study, [*lines, "", machine(load, alssnn, np) + "."])


def keep(path, study, lines):
    """Write the table of a study; those of others stay."""
    head = (
        "# Continuous time\n\nBy `python -m benchmarks.continuous`, whose text says\n"
    )
    text = path.read_text() if path.exists() else head + "what is measured.\n"
    parts = text.split("\n## ")
    tables = {part.split("\n", 1)[0]: part for part in parts[1:]}
    tables[study] = "\n".join([study, "", *lines, ""])
    ordered = [tables[name] for name in STUDIES if name in tables]
    path.write_text("\n## ".join([parts[0].rstrip("\n") + "\n", *ordered]))


if __name__ == "__main__":
    main()
