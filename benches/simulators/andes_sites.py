"""Sites with a hidden effect, simulated by ANDES: the two-area network of Kundur and load models that are not the program's.

    andes_sites.py KIND SEED SITE_DIR [FRAMES_PER_S [NOISE]]

writes what `ramses.py` writes, from KIND (one of `KINDS`) and SEED alike. The load is at a bus of its own behind a transformer;
what is measured goes through that. An event that the simulator does not get through is drawn anew.
"""

import os
import sys

import andes
import numpy as np
from measurement import NETWORK_BASE_MVA, NOMINAL_HZ, arguments, even_grid, measure, write_event, write_site

CASE = "kundur/kundur_full.json"
# The bus of the load, the one of the network that feeds it, and the transformer between them, pu of `NETWORK_BASE_MVA`.
BUS, FEEDING = 70, 7
BASE_KV, TRANSFORMER_X, TRANSFORMER_TAP = 23.0, 0.05, 0.9
# Integration step, and a finer one until `FINE_S` after the event, s.
STEP_S, FINE_STEP_S, FINE_S = 1 / 240, 1 / 480, 1.5
END_S = 8.0
# What P and Q may move before the event, pu.
FLAT_PU = 1e-5
TRIES_MAX = 20

# What a kind hides.
KINDS = {
    "none": [],
    "second_motor": ["second_motor"],
    "double_cage": ["double_cage_rotor"],
    "frequency": ["static_frequency_dependence"],
    "generation": ["distributed_generation"],
    "generation+second_motor": ["distributed_generation", "second_motor"],
    "frequency+second_motor": ["static_frequency_dependence", "second_motor"],
}

# Kind, faulted bus; reactance of the fault, pu.
EVENTS = [
    ("fault", 7, (0.03, 0.06)),
    ("fault", 7, (0.06, 0.15)),
    ("fault", 6, (0.02, 0.05)),
    ("fault", 8, (0.01, 0.03)),
    ("fault", 5, (0.01, 0.03)),
    ("fault", 9, (0.005, 0.02)),
    ("fault+trip", 7, (0.05, 0.1)),
    ("double", 7, (0.06, 0.12)),
    ("line", 0, None),
    ("cap", 0, None),
    ("load", 0, None),
]


def motor(rng):
    """An induction motor of one cage, pu on its own base; inertia constant, s; load over rating."""
    return {
        "rs": rng.uniform(0.005, 0.02),
        "xs": rng.uniform(0.08, 0.14),
        "xr1": rng.uniform(0.08, 0.14),
        "xm": rng.uniform(2.5, 3.5),
        "rr1": rng.uniform(0.01, 0.03),
        "Hm": rng.uniform(0.3, 1.2),
        "loading": rng.uniform(0.65, 0.85),
    }


def site(kind, rng):
    """What is true of the load of a site; shares of motors and of `FLoad` are of P without generation.

    Names are those of the models of ANDES; resistances, reactances and inertia constants (s) of motors and the current limit are on
    the base of the device.
    """
    parts = kind.split("+")
    kpm, m = rng.uniform(0.3, 0.55), motor(rng)
    # Shares of constant impedance and constant current in P, and in Q.
    z = rng.uniform(0.2, 0.5), rng.uniform(0.15, 0.4), rng.uniform(0.5, 0.9), rng.uniform(0.05, 0.25)
    truth = {"kpm": kpm, "motor": m, "zip": z}
    if "second_motor" in parts:
        second = motor(rng)
        m |= {"Hm": rng.uniform(0.3, 0.45), "rr1": rng.uniform(0.022, 0.03)}
        second |= {"Hm": rng.uniform(0.9, 1.2), "rr1": rng.uniform(0.01, 0.014)}
        truth |= {"motor2": second, "share2": kpm * rng.uniform(0.4, 0.6)}
    if "double_cage" in parts:
        m |= {"rr1": rng.uniform(0.035, 0.06), "xr1": rng.uniform(0.08, 0.1)}
        m |= {"rr2": rng.uniform(0.01, 0.016), "xr2": rng.uniform(0.18, 0.3)}
    if "frequency" in parts:
        truth["fload"] = {
            "share": (1 - kpm) * rng.uniform(0.5, 0.8),
            "ap": rng.uniform(1.0, 2.0),
            "aq": rng.uniform(1.5, 2.5),
            "bp": rng.uniform(2.0, 3.5),
            "bq": -rng.uniform(1.5, 3.0),
        }
    if "generation" in parts:
        upper, lag_s = rng.uniform(0.72, 0.88), rng.uniform(0.02, 0.1)
        truth["generation"] = {
            "share": rng.uniform(0.15, 0.35),
            "vt0": upper - rng.uniform(0.1, 0.25),
            "vt1": upper,
            "tip": lag_s,
            "tiq": lag_s,
            "ialim": rng.uniform(1.1, 1.3),
        }
    return truth


def add_load(system, load, p, q, fed):
    """Adds the load of a site, pu of `NETWORK_BASE_MVA`: P less what generation feeds, Q without that of motors."""
    gross = p + fed
    shares = {"MA": (load["kpm"] - load.get("share2", 0.0), load["motor"])}
    if "motor2" in load:
        shares["MB"] = load["share2"], load["motor2"]
    for idx, (share, m) in shares.items():
        values = {name: value for name, value in m.items() if name != "loading"}
        rating = share * gross / m["loading"] * NETWORK_BASE_MVA
        values |= {"Sn": rating, "Vn": BASE_KV, "c1": share * gross, "c2": 0.0, "c3": 0.0}
        system.add("Motor5" if "rr2" in m else "Motor3", {"idx": idx, "bus": BUS, **values})
    static = (1 - load["kpm"]) * gross
    of_fload = load["fload"]["share"] * gross if "fload" in load else 0.0
    voltages = {"vmax": 2.0, "vmin": 0.5}
    rest = 1 - of_fload / static
    system.add("PQ", {"idx": "static", "bus": BUS, "Vn": BASE_KV, "p0": static * rest, "q0": q * rest, **voltages})
    pz, pi, qz, qi = (100 * share for share in load["zip"])
    values = {"kpz": pz, "kpi": pi, "kpp": 100 - pz - pi, "kqz": qz, "kqi": qi, "kqp": 100 - qz - qi}
    system.add("ZIP", {"idx": "ZIP", "pq": "static", **values})
    system.add("BusFreq", {"idx": "seen", "bus": BUS})
    if "fload" in load:
        values = {name: value for name, value in load["fload"].items() if name != "share"}
        system.add("PQ", {"idx": "turning", "bus": BUS, "Vn": BASE_KV, "p0": of_fload, "q0": q * (1 - rest), **voltages})
        system.add("FLoad", {"idx": "FLoad", "pq": "turning", "busf": "seen", **values})


def add_generation(system, load, fed, voltage):
    """Adds inverters at unity power factor, whose static generator holds the voltage that there is when it feeds no Q.

    No reaction to frequency, no reactive support; above 1.3 pu the current is reduced too.
    """
    rating = fed * NETWORK_BASE_MVA
    static = {"idx": "fed", "bus": BUS, "Sn": rating, "Vn": BASE_KV, "p0": fed, "v0": voltage}
    system.add("PV", {**static, "pmax": 99.0, "pmin": 0.0, "qmax": 99.0, "qmin": -99.0})
    values = {name: value for name, value in load["generation"].items() if name != "share"}
    values |= {"vt2": 1.3, "vt3": 1.4, "v0": 0.1, "v1": 1.9}
    values |= {f"ft{k}": hz for k, hz in enumerate((50.0, 51.0, 69.0, 70.0))}
    system.add("PVD1", {"idx": "PVD1", "bus": BUS, "gen": "fed", "Sn": rating, "pqflag": 1, "busf": "seen", **values})


def add_event(system, event):
    """Adds faults and switchings."""
    at_s, kind = event["t"], event["kind"]
    lasting_s = event["cycles"] / NOMINAL_HZ
    begins = {"double": [at_s, at_s + 0.5 + lasting_s], "fault": [at_s], "fault+trip": [at_s]}.get(kind, [])
    for begin_s in begins:
        system.add("Fault", {"bus": event["bus"], "tf": begin_s, "tc": begin_s + lasting_s, "xf": event["xf"]})
    if kind in ("fault+trip", "line"):
        system.add("Toggle", {"model": "Line", "dev": event["line"], "t": at_s + lasting_s})
    elif kind == "cap":
        system.add("Shunt", {"idx": "switched", "bus": FEEDING, "Vn": 230.0, "b": event["b"], "u": event["was"]})
        system.add("Toggle", {"model": "Shunt", "dev": "switched", "t": at_s})
    elif kind == "load":
        system.add("PQ", {"idx": "switched", "bus": 8, "Vn": 230.0, "p0": event["p"], "q0": 0.0})
        system.add("Toggle", {"model": "PQ", "dev": "switched", "t": at_s})


def network(load, event, p, q, fed, voltage):
    """The network with the load; generation as negative load if no `voltage` is given for it."""
    system = andes.load(andes.get_case(CASE), setup=False, no_output=True, default_config=True)
    system.Toggle.u.v[0] = 0
    system.add("Bus", {"idx": BUS, "name": "L", "Vn": BASE_KV})
    between = {"bus1": FEEDING, "bus2": BUS, "Vn1": 230.0, "Vn2": BASE_KV, "r": 0.0, "x": TRANSFORMER_X}
    system.add("Line", {"idx": "transformer", "Sn": NETWORK_BASE_MVA, "trans": 1, "tap": TRANSFORMER_TAP, **between})
    # The bus that feeds the site keeps its P.
    system.PQ.p0.v[0] -= p
    add_load(system, load, p, q, fed)
    add_event(system, event)
    if fed and voltage is None:
        system.add("PQ", {"idx": "fed", "bus": BUS, "Vn": BASE_KV, "p0": -fed, "q0": 0.0})
    elif fed:
        add_generation(system, load, fed, voltage)
    system.setup()
    # A Jacobian of motors changes its pattern from one iteration to the next.
    system.PFlow.config.linsolve = 1
    system.PFlow.config.tol = 1e-10
    begin = system.PFlow.init

    def begin_running():
        # ANDES begins at standstill and may end at the slip where a motor stalls.
        begin()
        for machines in (system.Motor3, system.Motor5):
            system.dae.x[machines.slip.a] = 0.02
        system.vars_to_models()

    system.PFlow.init = begin_running
    if not system.PFlow.run():
        raise RuntimeError("no load flow")
    return system


def simulate(load, event, p, q, fed):
    """Time, modulus and angle of the voltage at the load in the nominal frame, and current into it, pu."""
    voltage = None
    if fed:
        system = network(load, event, p, q, fed, None)
        voltage = system.Bus.get("v", BUS)
    system = network(load, event, p, q, fed, voltage)
    for machines in (system.Motor3, system.Motor5):
        if machines.n and not (0 < machines.slip.v.min() and machines.slip.v.max() < 0.1):
            raise RuntimeError("a motor does not run")
    config = system.TDS.config
    config.linsolve, config.no_tqdm, config.tol = 1, 1, 1e-6
    system.TDS.init()
    if system.PVD1.n:
        # ANDES begins with the reactive current at its lower limit.
        system.dae.x[system.PVD1.Iqout_y.a] = 0.0
        system.vars_to_models()
        system.TDS.fg_update(system.exist.pflow_tds, init=True)
    if not system.TDS.test_init():
        raise RuntimeError("no equilibrium")
    stages = [(event["t"] - 0.01, STEP_S), (event["t"] + FINE_S, FINE_STEP_S), (event["end"], STEP_S)]
    for config.tf, config.tstep in stages:
        if not system.TDS.run():
            raise RuntimeError(system.TDS.err_msg)
    series = system.dae.ts
    at = [system.Bus.idx2uid(bus) for bus in (FEEDING, BUS)]
    modulus, angle = (series.y[:, var.a[at]] for var in (system.Bus.v, system.Bus.a))
    far, near = (modulus * np.exp(1j * angle)).T
    current = (far / TRANSFORMER_TAP - near) / (1j * TRANSFORMER_X)
    before = series.t < event["t"]
    drawn = (near * np.conj(current))[before]
    if max(np.ptp(drawn.real), np.ptp(drawn.imag)) > FLAT_PU:
        raise RuntimeError("no rest before the event")
    return series.t, modulus[:, 1], angle[:, 1], current


def phasors(course):
    """Complex voltage and current on the even grid."""
    time_s, modulus, angle, current = course
    grid = even_grid(time_s)
    voltage = np.interp(grid, time_s, modulus) * np.exp(1j * np.interp(grid, time_s, np.unwrap(angle)))
    return voltage, np.interp(grid, time_s, current.real) + 1j * np.interp(grid, time_s, current.imag), time_s[-1]


def draw_event(kind, bus, reactance, rng):
    event = {"kind": kind, "bus": bus, "cycles": 0, "t": rng.uniform(1.2, 1.6), "end": END_S}
    if reactance:
        event |= {"cycles": int(rng.integers(4, 13)), "xf": rng.uniform(*reactance)}
    if kind in ("fault+trip", "line"):
        event["line"] = str(rng.choice(["Line_2", "Line_4"]))
    elif kind == "cap":
        event |= {"b": rng.uniform(0.8, 1.6), "was": int(rng.integers(2))}
    elif kind == "load":
        event["p"] = rng.uniform(1.5, 3.0)
    return event


def main():
    kind, folder, frames_per_s, noise, rng = arguments(__doc__, KINDS)
    andes.config_logger(stream_level=50)
    load = site(kind, rng)
    os.makedirs(folder, exist_ok=True)
    p, q = rng.uniform(1.5, 1.95), rng.uniform(0.2, 0.4)
    fed = load["generation"]["share"] * p if "generation" in load else 0.0
    written = []
    for number in rng.permutation(len(EVENTS))[: rng.integers(8, 12)]:
        course, tries = None, 0
        while course is None:
            tries += 1
            if tries > TRIES_MAX:
                sys.exit(f"{folder}: none of {TRIES_MAX} such events works")
            event = draw_event(*EVENTS[number], rng)
            of_day = rng.uniform(0.88, 1.12)
            try:
                course = simulate(load, event, p * of_day, q * of_day * rng.uniform(0.91, 1.09), fed)
            except RuntimeError as error:
                print(f"{folder}: {event['kind']} at bus {event['bus']} drawn anew: {error}", file=sys.stderr)
        name = write_event(folder, len(written) + 1, measure(*phasors(course), frames_per_s, noise, rng))
        written.append({"file": name, **event, "v_min": float(course[1].min())})
    parameters = {**load, "fed_mw": fed * NETWORK_BASE_MVA} if fed else load
    truth = {"effects": KINDS[kind], "parameters": parameters, "noise": noise, "events": written}
    write_site(folder, frames_per_s, BASE_KV, truth)


if __name__ == "__main__":
    main()
