#!/usr/bin/env python3
"""What it costs a multistart to find every solution near the best, which the program's search does.

For each problem the solutions within 5 % of the best that the study's scan or fit found; local solves of SciPy's TRF
from uniform starts, each to its own end; from the share of starts that end in each solution the number of starts after
which all are found with 99 % probability, and its CPU time. The program's row is its whole search, which also knows
that it has ended.
"""

import argparse
import json
import math
import os
import statistics
import sys
import time

for variable in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "RAYON_NUM_THREADS"):
    os.environ[variable] = "1"

import numpy

import methods
import simulator
from run import OBJECTIVE_FLOOR

# Solutions count up to this share above the best.
NEAR = 0.05
# Two points are one solution when half the weighted square of the difference of their curves is below this share of
# the objective, ten times what the program asks for, or below the constant.
SAME_SHARE, SAME_LEAST = 1e-3, 0.05
CHANCE = 0.99


def arguments():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--study", required=True, help="JSON of `cargo bench --bench study`")
    parser.add_argument("--problems", type=int, default=43)
    parser.add_argument("--step", type=int, default=7)
    parser.add_argument("--starts", type=int, default=60)
    parser.add_argument("--json")
    return parser.parse_args()


def main():
    options = arguments()
    with open(options.study, encoding="utf-8") as file:
        study = json.load(file)
    library = simulator.library()
    problems = {p["index"]: p for p in study["problems"]}
    records = []
    for index in (k * options.step for k in range(options.problems)):
        records.append(one_problem(library, study["seed"], problems[index], options.starts))
        print(records[-1], file=sys.stderr)
    report(records, options)
    if options.json:
        with open(options.json, "w", encoding="utf-8") as file:
            json.dump(records, file, indent=1)


def one_problem(library, seed, studied, starts):
    problem = simulator.Problem(library, seed, studied["index"])
    form = problem.form("reduced")
    solutions = near_solutions(form, studied["scan"] + studied["fit"])
    program = [problem.fit()[2][2] for _ in range(3)]
    random = numpy.random.default_rng([seed, studied["index"], 0])
    hits, costs, evaluations = [0] * len(solutions), [], []
    for _ in range(starts):
        began = time.thread_time()
        recorder = methods.Recorder(form, 3000, -math.inf)
        end = local_solution(recorder, random)
        costs.append(time.thread_time() - began)
        evaluations.append(recorder.evaluations)
        found = None if end is None else curves(form, end)
        for number, solution in enumerate(solutions):
            hits[number] += found is not None and same(solution, found)
    problem.close()
    return {
        "index": studied["index"],
        "solutions": len(solutions),
        "hits": hits,
        "starts": starts,
        "seconds_per_start": statistics.mean(costs),
        "evaluations_per_start": statistics.mean(evaluations),
        "program_seconds": statistics.mean(program),
        "to_best": starts_needed(hits[:1], starts),
        "to_all": starts_needed(hits, starts),
    }


def local_solution(recorder, random):
    """Where one local solve ends: the best point it saw."""
    start = recorder.start(random)
    # Drawing the start may have seen a lower point than the solve ends at: only the solve counts.
    recorder.best, recorder.point = math.inf, None
    try:
        methods.trust_region_reflective(recorder, start)
    except (methods.Finished, ValueError, numpy.linalg.LinAlgError):
        pass
    return recorder.point


def curves(form, x):
    found = form.residuals(numpy.asarray(x, dtype=float))
    return None if found is None else found[0]


def objective(residuals):
    return 0.5 * float(residuals @ residuals)


def same(a, b):
    larger = max(objective(a), objective(b))
    return objective(a - b) <= SAME_SHARE * larger + SAME_LEAST


def near_solutions(form, found):
    """Curves of the different solutions within 5 % of the best, best first."""
    found = sorted(found, key=lambda s: s["objective"])
    limit = found[0]["objective"] + NEAR * max(found[0]["objective"], OBJECTIVE_FLOOR)
    kept = []
    for solution in found:
        if solution["objective"] > limit:
            break
        here = curves(form, solution["x"])
        if here is not None and not any(same(k, here) for k in kept):
            kept.append(here)
    return kept


def starts_needed(hits, starts):
    """Starts after which each is found with CHANCE in all; none where one was never hit."""
    if min(hits) == 0:
        return None
    missing = lambda n: sum((1 - hit / starts) ** n for hit in hits)
    return next(n for n in range(1, 10**6) if missing(n) <= 1 - CHANCE)


def report(records, options):
    def row(name, key):
        reached = [r for r in records if r[key] is not None]
        seconds = [r[key] * r["seconds_per_start"] for r in reached]
        ratios = [s / r["program_seconds"] for s, r in zip(seconds, reached)]
        print(
            f"| {name} | {len(reached)} of {len(records)} "
            f"| {statistics.median(r[key] for r in reached):.0f} "
            f"| {1e3 * statistics.median(seconds):.1f} | {1e3 * ninety(seconds):.1f} "
            f"| {statistics.median(ratios):.1f} | {sum(seconds) / sum(r['program_seconds'] for r in reached):.1f} |"
        )

    several = sum(r["solutions"] > 1 for r in records)
    print(f"{len(records)} problems, {several} with more than one solution near the best, {options.starts} starts each")
    print("| | reached | starts, median | CPU ms, median | 90 % | CPU over the program's, median | in sum |")
    print("|---|---|---|---|---|---|---|")
    row("TRF multistart to the best, 99 %", "to_best")
    row("TRF multistart to every solution within 5 %, 99 %", "to_all")
    program = [r["program_seconds"] for r in records]
    print(f"| program, whole search | {len(records)} of {len(records)} | | {1e3 * statistics.median(program):.1f} | {1e3 * ninety(program):.1f} | 1 | 1 |")


def ninety(values):
    return sorted(values)[min(len(values) - 1, int(0.9 * len(values)))]


if __name__ == "__main__":
    main()
