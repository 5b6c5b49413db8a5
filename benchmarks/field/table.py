"""What many runs say together: medians, worst seeds, and the fits that failed."""

from dataclasses import dataclass, field

import numpy as np

from .case import floor

WORSE = 1.02  # of the error of the linear model: what counts as lost against it
AGREE = (1.3, 2.0)  # worst over median of the seeds
NETWORKS = ("fl", "al", "gr")
MEASURED = "real"  # the split of measured records


@dataclass(frozen=True)
class Group:
    """Hold the seeds of one model on one test."""

    case: str
    test: str
    model: str
    options: str
    rows: list = field(repr=False)

    def values(self, column):
        """Return a column as numbers; nan where a fit crashed."""
        return np.array([float(row[column] or "nan") for row in self.rows])

    @property
    def spread(self):
        """Return worst over median; infinite if a fit crashed or diverged."""
        values = self.values("rmse")
        if not np.isfinite(values).all():
            return np.inf
        return values.max() / np.median(values)


@dataclass(frozen=True)
class Summary:
    """Count what must not happen, in fits of nonlinear models."""

    fits: int  # rows of nonlinear models
    crashes: list
    diverging: list
    worse: list  # than the linear model by more than 2 %
    silent: list  # of the worse and the diverging, those without any warning
    agree: dict  # limit -> share of the groups


def groups(rows):
    """Return the rows by case, test, model and options, in their order."""
    parts = {}
    for row in rows:
        key = tuple(row[k] for k in ("case", "test", "model", "options"))
        parts.setdefault(key, []).append(row)
    # a fit that crashed before it knew its tests stands alone
    return [Group(*key, part) for key, part in parts.items()]


def summary(rows):
    """Return the counts over all rows of nonlinear models."""
    rows = [row for row in rows if row["model"] != "lti"]
    crashes = [row for row in rows if row["error"]]
    diverging = [row for row in rows if row["rmse"] == "inf"]
    worse = [
        row
        for row in rows
        if row["rmse"] != "inf" and float(row["relative"] or "nan") > WORSE
    ]
    silent = [row for row in diverging + worse if not row["warnings"]]
    spreads = np.array([group.spread for group in groups(rows)])
    agree = {limit: float(np.mean(spreads <= limit)) for limit in AGREE if len(spreads)}
    return Summary(len(rows), crashes, diverging, worse, silent, agree)


def report(rows, cases):
    """Return the lines of the table and of the summary.

    `cases` tells units and published errors by the name of a case.
    """
    lines = []
    by_test = {}
    for group in groups(rows):
        by_test.setdefault((group.case, group.test), []).append(group)
    for (name, test), part in sorted(
        by_test.items(), key=lambda item: _place(item[0][0], cases)
    ):
        case = cases.get(name)
        unit, split = (case.unit, case.split) if case else ("", "")
        lines += ["", f"{name}, {test} [{unit}] {split}"]
        lines += [_row(group) for group in part]
        for source, errors in (case.published if case else {}).items():
            if test in errors:
                lines.append(f"  {source:32s}{'':6s}{errors[test]:12.4g}  published")
    return [*lines, "", *_counts(summary(rows))]


def page(rows, cases):
    """Return the manual's table of plants that have default fits of all models."""
    lines = []
    for name, case in cases.items():
        parts = _by_model(rows, case=name)
        if case.split == MEASURED or not all(parts.values()):
            continue
        linear = np.mean([float(row["rmse"]) for row in parts["lti"]])
        size = np.mean([float(row["std"]) for row in parts["lti"]])
        noise = floor(case) / linear
        errors = [_by_seed(parts[model]) for model in NETWORKS]
        cells = [_median_and_worst(error) for error in errors]
        cells += [_left_by_the_law(parts["al"])]
        cells += [_counts_of_seeds(errors)]
        cells += [f"{noise:.2f}" if np.isfinite(noise) else ""]
        lines.append(f"   {name}, {size:.3f}, {', '.join(cells)}")
    head = [
        ".. csv-table:: Default fits: the error of the linear model over the standard",
        "   deviation of the output; and over the error of the linear model, those of",
        "   the networks, medians of the seeds and in brackets the worst where it is",
        f"   above {AGREE[0]} medians; the linearization error of AlSsnn, median of",
        "   its seeds; the number of seeds, of each where it differs; and the noise,",
        "   which no model goes below",
        "   :header: case, LinearStateSpace, FlSsnn, AlSsnn, GrSsnn, "
        "left by the law, seeds, noise",
        "   :widths: auto",
        "",
    ]
    return [*head, *lines]


def records_page(rows, cases):
    """Return the manual's table of measured records, one line per test."""
    lines = []
    tests = dict.fromkeys((row["case"], row["test"]) for row in rows)
    for name, test in sorted(tests, key=lambda key: _place(key[0], cases)):
        case = cases.get(name)
        parts = _by_model(rows, case=name, test=test)
        if case is None or case.split != MEASURED or not all(parts.values()):
            continue
        errors = [
            np.array([float(row["rmse"] or "nan") for row in part])
            for part in parts.values()
        ]
        cells = [_median_and_worst(error, "#.3g") for error in errors]
        known = [
            f"{source.removesuffix(' [1]')} {errors[test]:.3g}"
            for source, errors in case.published.items()
            if test in errors
        ]
        cells = [name, f'"{test}"', case.unit, *cells, _counts_of_seeds(errors[1:])]
        lines.append(f'   {", ".join(cells)}, "{"; ".join(known)}"')
    head = [
        ".. csv-table:: Default fits of measured records: the error of the simulated",
        "   test, medians of the seeds and in brackets the worst where it is above",
        f"   {AGREE[0]} medians; the number of seeds; and what others published",
        "   :header: record, test, unit, LinearStateSpace, FlSsnn, AlSsnn, GrSsnn, "
        "seeds, published",
        "   :widths: auto",
        "",
    ]
    return [*head, *lines]


def _by_model(rows, **key):
    """Return the default fits of a case, or of a test of it, by model."""
    fits = [
        row
        for row in rows
        if not row["options"] and all(row[k] == v for k, v in key.items())
    ]
    return {m: [r for r in fits if r["model"] == m] for m in ("lti", *NETWORKS)}


def _counts_of_seeds(errors):
    """Return the number of seeds of each model, once if it is the same."""
    counts = [f"{len(error)}" for error in errors]
    return counts[0] if len(set(counts)) == 1 else "/".join(counts)


def _by_seed(rows):
    """Return the error of every seed over that of the linear model, all tests."""
    seeds = sorted({row["seed"] for row in rows}, key=int)
    return np.array(
        [
            np.mean([float(r["relative"] or "nan") for r in rows if r["seed"] == seed])
            for seed in seeds
        ]
    )


def _left_by_the_law(rows):
    """Return the median linearization error in percent; empty where it is unknown."""
    shares = [float(row["linearization"] or "nan") for row in rows]
    return f"{np.median(shares):.1%}" if np.isfinite(shares).all() else ""


def _median_and_worst(errors, form=".2f"):
    middle, worst = np.median(errors), np.max(errors)  # nan of a fit that crashed
    text = f"{middle:{form}}"
    return text if worst <= AGREE[0] * middle else f"{text} ({worst:{form}})"


def _place(name, cases):
    names = list(cases)
    return names.index(name) if name in names else len(names)


def _row(group):
    error, relative = group.values("rmse"), group.values("relative")
    n_crashed = int(np.isnan(error).sum())
    label = f"{group.model} {group.options}".strip()
    if n_crashed == len(error):
        return f"  {label:32s}{len(error):4d}  crashed: {group.rows[0]['error'][:60]}"
    fitted = ~np.isnan(error)
    error, relative, seconds = (
        z[fitted] for z in (error, relative, group.values("cpu"))
    )
    middle, worst = np.median(relative), relative.max()
    marks = [f"{n_crashed} crashed"] * bool(n_crashed)
    marks += ["diverges"] * bool(np.isinf(error).any())
    marks += ["worse than lti"] * bool(group.model != "lti" and worst > WORSE)
    return (
        f"  {label:32s}{len(group.rows):4d}  {np.median(error):12.4g}"
        f"  of lti {middle:8.3f} worst {worst:8.3f}"
        f"  nx {'/'.join(dict.fromkeys(row['nx'] for row in group.rows)):8s}"
        f"{np.median(seconds):8.1f} s  {', '.join(marks)}"
    )


def _counts(found):
    lines = [
        f"{found.fits} errors of nonlinear models: {len(found.crashes)} crashed, "
        f"{len(found.diverging)} diverging, {len(found.worse)} worse than the linear "
        f"model by more than {WORSE - 1:.0%}; {len(found.silent)} of these without a "
        "warning"
    ]
    for label, part in (
        ("crashed", found.crashes),
        ("diverging", found.diverging),
        ("worse", found.worse),
    ):
        lines += [f"  {label}: {_name(row)}" for row in part]
    lines += [
        f"worst/median over the seeds <= {limit:g}: {share:.0%} of models and tests"
        for limit, share in found.agree.items()
    ]
    return lines


def _name(row):
    what = row["error"][:80] or f"{row['relative']} of lti"
    text = f"{row['case']}, {row['test']}, {row['model']} seed {row['seed']}"
    return f"{text} {row['options']}".rstrip() + f": {what}"
