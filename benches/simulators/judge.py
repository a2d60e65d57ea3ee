"""What the program finds at sites whose truth is known.

    judge.py PROGRAM FOLDER

runs `PROGRAM improve SITE --json` on every site of FOLDER that has a `SITE.truth.json` beside it, two at a time, keeps the
answers in `FOLDER/answers`, where one that is there already is not asked for again, and prints a row for each.
"""

import concurrent.futures
import json
import os
import pathlib
import subprocess
import sys

TIME_MAX_S = 1800


def answer(program, site, kept):
    if not kept.exists():
        alone = {**os.environ, "RAYON_NUM_THREADS": "1"}
        command = [program, "improve", str(site), "--json"]
        done = subprocess.run(command, capture_output=True, env=alone, timeout=TIME_MAX_S, check=False)
        if done.returncode != 0:
            raise RuntimeError(f"{site}: {done.stderr.decode(errors='replace').strip()[-400:]}")
        # Whole or not at all: who is cut off in between asks again.
        part = kept.with_suffix(".part")
        part.write_bytes(done.stdout)
        part.replace(kept)
    return json.loads(kept.read_text())


def names(answer_set):
    return [each if isinstance(each, str) else each["name"] for each in answer_set]


def errors(step):
    sets = (step.get(name) or {} for name in ("fit", "held_out", "untouched"))
    return " / ".join(f"{each['error_to_noise']:.2f}" if "error_to_noise" in each else "-" for each in sets)


def row(name, truth, found):
    first = found["diagnoses"][0]
    said = ", ".join(names(first["answer_set"])) or first["status"]
    dropped = {name for step in found["steps"] for name in step["dropped"]}
    added = [step["added"] for step in found["steps"] if step["added"]]
    steps = [f"({name})" if name in dropped else name for name in added]
    either = "".join(f" (or {each})" for each in truth.get("equally_right", []))
    cells = [name, (", ".join(truth["effects"]) or "nothing") + either, said, ", ".join(steps) or "-"]
    cells += [errors(found["steps"][0]), errors(found["steps"][-1])]
    return "| " + " | ".join(cells) + " |"


def main():
    if len(sys.argv) != 3:
        sys.exit(__doc__)
    program, folder = sys.argv[1], pathlib.Path(sys.argv[2])
    answers = folder / "answers"
    answers.mkdir(exist_ok=True)
    truths = sorted(folder.glob("*.truth.json"))
    print("| site | hidden | first answer | added | errors at the start | at the end |\n|---|---|---|---|---|---|")
    with concurrent.futures.ThreadPoolExecutor(2) as pool:

        def judged(path):
            name = path.name.removesuffix(".truth.json")
            try:
                found = answer(program, folder / name, answers / f"{name}.json")
            except (RuntimeError, subprocess.TimeoutExpired) as error:
                return f"| {name} | {error} |"
            return row(name, json.loads(path.read_text()), found)

        for line in pool.map(judged, truths):
            print(line, flush=True)


if __name__ == "__main__":
    main()
