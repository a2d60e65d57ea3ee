#!/usr/bin/env python3
"""The program's fit and its peers on the same problems in one run, in one process, on one thread.

A method has solved a problem when its best objective lies within 0.1 % (1 %) of the best that any
method, the program or the scan found. Costs are those until it came within 1 %.
"""

import argparse
import json
import os
import statistics
import sys

for variable in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "RAYON_NUM_THREADS"):
    os.environ[variable] = "1"

import numpy

import methods
import simulator

PROGRAM = "loadmodeld (whole search)"
# Objectives are not compared finer than relative to this: noise of 0.01 % of P0 where 0.1 % is assumed.
OBJECTIVE_FLOOR = 6.0
CLOSE, NEAR = 1e-3, 1e-2


def arguments():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--problems", type=int, default=300)
    parser.add_argument("--first", type=int, default=0)
    parser.add_argument("--step", type=int, default=1, help="every so many problems")
    parser.add_argument("--seed", type=int, default=2014, help="of the problems and the methods")
    parser.add_argument("--evaluations", type=int, default=3000, help="cap for each method")
    parser.add_argument("--form", choices=["reduced", "paper"], default="reduced")
    parser.add_argument("--methods", nargs="*", default=list(methods.METHODS))
    parser.add_argument("--scan", help="JSON of `cargo bench --bench study`: its minima count too")
    parser.add_argument("--full", action="store_true", help="use up the cap: do not end a method once it equals the best of program and scan")
    parser.add_argument("--json", help="write everything here")
    parser.add_argument("--check", action="store_true", help="check the derivatives and end")
    return parser.parse_args()


def main():
    options = arguments()
    library = simulator.library()
    if options.check:
        check(library, options)
        return
    scanned = minima_of_scan(options)
    records = []
    for index in indices(options):
        records.append(one_problem(library, options, index, scanned.get(index)))
        print(f"problem {index}: best {records[-1]['best']:.6g}", file=sys.stderr)
    print(table(records, options))
    if options.json:
        with open(options.json, "w", encoding="utf-8") as file:
            json.dump({"options": vars(options), "problems": records}, file, indent=1)


def indices(options):
    return [options.first + k * options.step for k in range(options.problems)]


def minima_of_scan(options):
    """Best objective of the dense scan per problem; only the reduced form is scanned."""
    if not options.scan or options.form != "reduced":
        return {}
    with open(options.scan, encoding="utf-8") as file:
        study = json.load(file)
    if study["seed"] != options.seed:
        sys.exit(f"{options.scan} is of seed {study['seed']}, not {options.seed}")
    return {p["index"]: min(s["objective"] for s in p["scan"]) for p in study["problems"]}


def one_problem(library, options, index, scan_best):
    problem = simulator.Problem(library, options.seed, index)
    form = problem.form(options.form)
    runs = {}
    best = float("inf") if scan_best is None else scan_best
    if options.form == "reduced":
        value, x, cost = problem.fit()
        runs[PROGRAM] = {
            "best": value,
            "x": list(x),
            "evaluations": cost[0] + cost[1],
            "cpu_s": cost[2],
            "solutions": cost[3],
            "trace": [(cost[0] + cost[1], cost[2], value)],
            "failure": None,
        }
        best = min(best, value)
    enough = best + 1e-5 * max(best, OBJECTIVE_FLOOR) if not options.full else -float("inf")
    enough = enough if numpy.isfinite(best) else -float("inf")
    for name in options.methods:
        # The same starts whichever methods run beside it.
        seed = [options.seed, index, list(methods.METHODS).index(name)]
        recorder, failure = methods.run(name, form, options.evaluations, enough, seed)
        runs[name] = {
            "best": recorder.best,
            "x": None if recorder.point is None else list(recorder.point),
            "evaluations": recorder.evaluations,
            "trace": recorder.trace,
            "failure": failure,
        }
    problem.close()
    best = min([best] + [run["best"] for run in runs.values()])
    return {"index": index, "best": best, "scan": scan_best, "runs": runs}


def reached(run, best, share):
    """Evaluations and CPU seconds until the run came within `share` of the best, or none."""
    limit = best + share * max(best, OBJECTIVE_FLOOR)
    return next(((e, t) for e, t, value in run["trace"] if value <= limit), None)


def table(records, options):
    lines = [
        f"{len(records)} problems of seed {options.seed}, {options.form} form, "
        f"at most {options.evaluations} evaluations each",
        "",
        "| method | within 0.1 % | within 1 % | evaluations to 1 %: median | 90 % "
        "| CPU ms to 1 %: median | 90 % | beats the program by > 0.1 % | errors |",
        "|---|---|---|---|---|---|---|---|---|",
    ]
    names = ([PROGRAM] if options.form == "reduced" else []) + options.methods
    for name in names:
        runs = [(r["runs"][name], r) for r in records]
        close = sum(reached(run, r["best"], CLOSE) is not None for run, r in runs)
        near = [n for n in (reached(run, r["best"], NEAR) for run, r in runs) if n]
        beats = sum(beaten(run, r["runs"].get(PROGRAM)) for run, r in runs)
        failures = sum(run["failure"] is not None for run, _ in runs)
        cells = [
            name,
            percent(close, records),
            percent(len(near), records),
            quantile([n[0] for n in near], 0.5, "{:.0f}"),
            quantile([n[0] for n in near], 0.9, "{:.0f}"),
            quantile([1e3 * n[1] for n in near], 0.5, "{:.1f}"),
            quantile([1e3 * n[1] for n in near], 0.9, "{:.1f}"),
            str(beats),
            str(failures),
        ]
        lines.append("| " + " | ".join(cells) + " |")
    return "\n".join(lines)


def beaten(run, program):
    if program is None:
        return False
    return program["best"] - run["best"] > CLOSE * max(run["best"], OBJECTIVE_FLOOR)


def percent(count, records):
    return f"{100 * count / len(records):.1f} %"


def quantile(values, share, shape):
    if not values:
        return "-"
    if share == 0.5:
        return shape.format(statistics.median(values))
    return shape.format(sorted(values)[min(len(values) - 1, int(share * len(values)))])


def check(library, options):
    """Gradients of both forms against central differences, residuals against values."""
    worst = {}
    for index in indices(options):
        problem = simulator.Problem(library, options.seed, index)
        for name in ("reduced", "paper"):
            form = problem.form(name)
            random = numpy.random.default_rng(index)
            x = next(
                x
                for x in (random.uniform(form.lower, form.upper) for _ in range(10**4))
                if form.value(x) < methods.UNDEFINED
            )
            value, gradient, _ = form.expansion(x)
            residuals, jacobian = form.residuals(x)
            step = 1e-5
            differences = numpy.array(
                [
                    (form.value(x + step * e) - form.value(x - step * e)) / (2 * step)
                    for e in numpy.eye(form.unknowns)
                ]
            )
            scale = numpy.abs(gradient).max() + 1e-3 * value
            errors = {
                "value": abs(0.5 * residuals @ residuals - value) / value,
                "gradient": numpy.abs(gradient - differences).max() / scale,
                "jacobian": numpy.abs(jacobian.T @ residuals - gradient).max() / scale,
            }
            for what, error in errors.items():
                key = f"{name} {what}"
                worst[key] = max(worst.get(key, (0.0, -1)), (float(error), index))
        problem.close()
    for what, (error, index) in worst.items():
        print(f"{what}: largest relative error {error:.1e} (problem {index})")


if __name__ == "__main__":
    main()
