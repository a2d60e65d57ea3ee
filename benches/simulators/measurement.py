"""What a phasor measurement unit says of a simulated load, and the site folder that it goes into."""

import json
import os
import sys

import numpy as np

NOMINAL_HZ = 60.0
NETWORK_BASE_MVA = 100.0
SITE_BASE_MVA = 200.0
# What is measured starts and ends this long after and before the simulation, s.
MARGIN_S = 0.05
GRID_S = 5e-4


def even_grid(time_s):
    """The instants at which `measure` wants phasors, s."""
    return np.arange(0, time_s[-1], GRID_S)


def measure(voltage, current, end_s, frames_per_s, noise, rng):
    """Rows of a recording: a triangle over two cycles acts on voltage and current (P class), then noise is added.

    Phasors are on the even grid of a simulation that ends at `end_s`, pu of `NETWORK_BASE_MVA`, in the nominal frame.
    """
    grid = GRID_S * np.arange(len(voltage))
    half = round(1 / NOMINAL_HZ / GRID_S)
    window = 1 - np.abs(np.arange(-half, half + 1)) / half
    window /= window.sum()
    voltage, current = (np.convolve(x, window, "same") for x in (voltage, current))
    stamps = np.arange(int((end_s - 2 * MARGIN_S) * frames_per_s)) / frames_per_s + MARGIN_S
    stamps = stamps[stamps < grid[-1] - MARGIN_S]
    u, i = (np.interp(stamps, grid, x.real) + 1j * np.interp(stamps, grid, x.imag) for x in (voltage, current))
    turning = np.gradient(np.unwrap(np.angle(voltage)), GRID_S) / (2 * np.pi)
    count = len(stamps)
    seen = u * (1 + noise * rng.standard_normal(count) + 1j * noise * rng.standard_normal(count))
    drawn = u * np.conj(i)
    active = drawn.real + noise * drawn.real[0] * rng.standard_normal(count)
    reactive = drawn.imag + noise * 0.6 * abs(drawn[0]) * rng.standard_normal(count)
    frequency_hz = NOMINAL_HZ + np.interp(stamps, grid, turning) + 0.0015 * rng.standard_normal(count)
    to_site = NETWORK_BASE_MVA / SITE_BASE_MVA
    return np.column_stack(
        [
            stamps - stamps[0],
            np.abs(seen),
            np.degrees(np.unwrap(np.angle(seen))),
            frequency_hz,
            to_site * active,
            to_site * reactive,
        ]
    )


def arguments(usage, kinds):
    """Kind, folder, frames/s and noise of the command line, and the generator that kind and seed give."""
    if len(sys.argv) < 4 or sys.argv[1] not in kinds:
        sys.exit(f"{usage}\nKIND: {', '.join(kinds)}")
    kind, seed, folder = sys.argv[1], int(sys.argv[2]), sys.argv[3].rstrip("/")
    frames_per_s = int(sys.argv[4]) if len(sys.argv) > 4 else 60
    noise = float(sys.argv[5]) if len(sys.argv) > 5 else 0.001
    return kind, folder, frames_per_s, noise, np.random.default_rng([seed, sum(map(ord, kind))])


def write_event(folder, number, rows):
    """Writes a recording; its name."""
    name = f"event_{number:02d}.csv"
    with open(f"{folder}/{name}", "w", encoding="ascii") as file:
        file.write("time_s,v_pu,angle_deg,freq_hz,p_pu,q_pu,stat\n")
        for row in rows:
            file.write("%.6f,%.6f,%.4f,%.5f,%.6f,%.6f,0\n" % tuple(row))
    return name


def write_site(folder, frames_per_s, base_kv, truth):
    """Writes `site.json` and, beside the folder, what is hidden in it, `truth`."""
    written = truth["events"]
    stamps = [{"file": e["file"], "utc": f"2026-01-{k + 1:02d}T03:07:00Z"} for k, e in enumerate(written)]
    described = {"site": os.path.basename(folder), "sample_rate_fps": frames_per_s, "nominal_hz": NOMINAL_HZ}
    described |= {"base_mva": SITE_BASE_MVA, "base_kv": base_kv, "events": stamps}
    for path, content in ((f"{folder}/site.json", described), (f"{folder}.truth.json", truth)):
        with open(path, "w", encoding="ascii") as file:
            json.dump(content, file, indent=1, default=float)
    print(f"{folder}: {len(written)} events")
