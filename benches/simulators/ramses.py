"""Sites with a hidden effect, simulated by RAMSES (STEPSS): equations and a network that are not the program's.

    ramses.py KIND SEED SITE_DIR [FRAMES_PER_S [NOISE]]

writes a site folder and, beside it, `SITE_DIR.truth.json` with what is hidden in it. KIND is one of `KINDS`. Parameters,
operating points, instants and depths follow from KIND and SEED. Events during which the simulator fails are left out.
"""

import os
import sys
import tempfile

import numpy as np
import stepss
from measurement import GRID_S, NETWORK_BASE_MVA, NOMINAL_HZ, arguments, even_grid, measure, write_event, write_site

# What the parts of a pair hide.
PARTS = {
    "second_motor": "second_motor",
    "torque": "speed_dependent_torque",
    "frequency": "static_frequency_dependence",
    "recovery": "exponential_recovery",
    "dropout": "electronic_load_dropout",
    "motor_trip": "motor_undervoltage_trip",
    "feeder": "feeder_impedance",
    "generation_trip": "distributed_generation",
}

KINDS = {
    "none": [],
    "second_motor": ["second_motor"],
    "double_cage": ["double_cage_rotor"],
    "frequency": ["static_frequency_dependence"],
    "torque": ["speed_dependent_torque"],
    "recovery": ["exponential_recovery"],
    "motor_trip": ["motor_undervoltage_trip"],
    "dropout": ["electronic_load_dropout"],
    "generation_trip": ["distributed_generation"],
    "generation": ["distributed_generation"],
    "feeder": ["feeder_impedance"],
    "feeder+second_motor": ["feeder_impedance", "second_motor"],
    "tap": ["tap_changer", "feeder_impedance"],
    **{
        f"{one}+{other}": [PARTS[one], PARTS[other]]
        for one, other in [
            ("second_motor", "recovery"),
            ("second_motor", "frequency"),
            ("second_motor", "dropout"),
            ("second_motor", "motor_trip"),
            ("torque", "recovery"),
            ("torque", "dropout"),
            ("frequency", "recovery"),
            ("frequency", "motor_trip"),
            ("recovery", "dropout"),
            ("recovery", "motor_trip"),
            ("feeder", "recovery"),
            ("feeder", "frequency"),
            ("feeder", "dropout"),
            ("generation_trip", "recovery"),
            ("generation_trip", "second_motor"),
            ("generation_trip", "frequency"),
        ]
    },
}

# Kind, faulted bus, cycles; reactance of the fault, ohm.
EVENTS = [
    ("fault", "B5", 5),
    ("line", "", 0),
    ("fault", "B2", 12),
    ("fault", "B5", 15),
    ("fault", "B3", 6),
    ("fault+trip", "B3", 8),
    ("capout", "", 0),
    ("double", "B3", 5),
    ("cap", "", 0),
    ("fault", "B3", 4),
    ("gen", "", 0),
]
FAULT_REACTANCE_OHM = {
    ("B5", 5): (30, 50),
    ("B2", 12): (120, 200),
    ("B5", 15): (22, 38),
    ("B3", 6): (70, 130),
    ("B3", 8): (40, 75),
    ("B3", 5): (45, 90),
    ("B3", 4): (17, 27),
}

# Name, MVA, MW, inertia constant (s).
MACHINES = [("G1", 900, 830, 4.5), ("G2", 500, 460, 4.0), ("G3", 150, 135, 3.0)]


def motor(rng):
    """An induction motor on its own base; every other one has next to no stator resistance."""
    return {
        "rs": float(rng.choice([1e-6, rng.uniform(0.006, 0.03)])),
        "lls": rng.uniform(0.07, 0.12),
        "lm": rng.uniform(2.2, 3.8),
        "rr": rng.uniform(0.01, 0.035),
        "llr": rng.uniform(0.08, 0.18),
        "h": rng.uniform(0.25, 1.4),
        "A": 0.0,
        "B": 0.0,
        "LF": rng.uniform(0.6, 0.85),
    }


def motor_record(name, bus, share, m):
    return (
        f"INJEC INDMACH1 {name} {bus} {share:.6f} {share:.6f} 0. 0. 0. {m['rs']:.6f} {m['lls']:.4f} {m['lm']:.4f} "
        f"{m['rr']:.5f} {m['llr']:.4f} {m['h']:.4f} {m['A']:.3f} {m['B']:.3f} {m['LF']:.4f} ;"
    )


def zip_shares(rng):
    """Shares of constant impedance and constant current in P, and in Q."""
    active = rng.uniform(0.2, 0.5), rng.uniform(0.15, 0.4)
    return *active, rng.uniform(0.5, 0.9), rng.uniform(0.05, 0.25)


def static_record(name, bus, shares, z, by_frequency=(0.0, 0.0), local=False):
    """ZIP load: `vfd_load`, which measures the voltage through a lag of 3 ms, an admittance below 0.2 or 0.3 pu."""
    active, reactive = shares
    dp, dq = by_frequency
    low, option = (0.3, 1) if local else (0.2, 0)
    return (
        f"INJEC vfd_load {name} {bus} {active:.6f} {reactive:.6f} 0. 0. {dp:.4f} {z[0]:.4f} 2. {z[1]:.4f} 1. 0. "
        f"{dq:.4f} {z[2]:.4f} 2. {z[3]:.4f} 1. 0. 0. {low} {option} 0.05 ;"
    )


def generation(rng):
    """Inverters in the measured load: what they feed over its mean P, and their largest current over that at nominal voltage."""
    return {"share": rng.uniform(0.15, 0.35), "current_limit": rng.uniform(1.03, 1.3)}


def opening(rng):
    """When the inverters are disconnected: a delay after the voltage first falls below a threshold."""
    return {"delay_s": rng.uniform(0.06, 0.12), "voltage": rng.uniform(0.75, 0.87)}


def generation_record(name, bus, fed_mw, current_limit):
    """Constant active power at unity power factor within a current limit.

    `IBG` measures the voltage through a lag of 10 ms, follows its commands through 20 ms, up by ten times the largest current per
    second, and has a PLL of 50 ms. No reaction to frequency, no reactive support, no protection above 0.05 pu. Parameters:
    <https://stepss.sps-lab.org>, injector models.
    """
    most = current_limit * fed_mw / NETWORK_BASE_MVA
    return (
        f"INJEC IBG {name} {bus} 1. 1. 0. 0. {most:.6f} {most:.6f} 10. 0.02 0.01 100. 100. 100. 2. 50. 0.04 0.05 0.03 0.04 "
        "30. 90. 90. 0. 30. 100. 0. 0. 0. 0. 0. 0. 0. 0.5 1.5 0. 1. 0. 0.03 ;"
    )


def site(kind, rng):
    """The load of a site: its records, where it is connected, and what is true of it."""
    kpm, m, z = rng.uniform(0.3, 0.6), motor(rng), zip_shares(rng)
    behind, bus = None, "L"
    if kind.startswith("feeder"):
        behind = {"kv": 23.0, "r_ohm": rng.uniform(0.05, 0.12), "x_ohm": rng.uniform(0.2, 0.35)}
    if kind == "tap":
        behind = {"kv": 12.5, "x_percent": rng.uniform(8, 14)}
        steps, first, next_ = int(rng.choice([25, 33])), rng.uniform(1.2, 2.5), rng.uniform(0.6, 1.2)
        behind["ltc"] = f"DCTL LTC D-L D-L D -1 85. 115. {steps} 0.01 {first:.2f} {next_:.2f} ;"
    if behind:
        bus = "D"
    more, switched, fed = {}, None, None
    records = None
    if kind.endswith("second_motor"):
        second = motor(rng)
        m["h"], m["rr"] = rng.uniform(0.2, 0.4), rng.uniform(0.025, 0.04)
        second.update(h=rng.uniform(1.2, 1.8), rr=rng.uniform(0.008, 0.013))
        share = kpm * rng.uniform(0.4, 0.6)
        records = [
            motor_record("M1", bus, kpm - share, m),
            motor_record("M2", bus, share, second),
            static_record("L1", bus, (1 - kpm, 1 - kpm), z),
        ]
        more = {"motor2": second, "share2": share}
    elif kind == "double_cage":
        low, high = [0.07, 2.6, 0.01, 0.2, 0.05, 0.08, 0.5, 0.65], [0.1, 3.4, 0.016, 0.35, 0.08, 0.12, 1.2, 0.8]
        names = ["l1", "lm", "r2", "l2", "r3", "l3", "h", "LF"]
        more = {"r1": 0.012, **{n: rng.uniform(a, b) for n, a, b in zip(names, low, high)}}
        cage = " ".join(f"{more[n]:.4f}" for n in names[:7])
        records = [
            f"INJEC INDMACH2 M1 {bus} {kpm:.6f} {kpm:.6f} 0. 0. 0. 0.012 {cage} 0. 0. {more['LF']:.4f} ;",
            static_record("L1", bus, (1 - kpm, 1 - kpm), z),
        ]
    elif kind == "torque":
        m["A"] = 1.0
    elif kind == "frequency":
        more = {"dp": rng.uniform(1.5, 3.0), "dq": -rng.uniform(1.0, 2.5)}
        kpm = rng.uniform(0.25, 0.4)
        by_frequency = more["dp"], more["dq"]
        records = [
            motor_record("M1", bus, kpm, m),
            static_record("L1", bus, (1 - kpm, 1 - kpm), z, by_frequency, local=True),
        ]
    elif kind == "recovery":
        share = rng.uniform(0.25, 0.4)
        kpm, time_s = rng.uniform(0.25, 0.35), rng.uniform(1.2, 4.0)
        more = {"share": share, "tr": time_s}
        records = [
            motor_record("M1", bus, kpm, m),
            static_record("L1", bus, (1 - kpm - share, 1 - kpm), z),
            f"INJEC RESTLD X1 {bus} {share:.6f} 0. 0. 0. 0. 2. 0. 0.2 3. 0. 2. 0. 0.2 3. {time_s:.3f} ;",
        ]
    elif kind in ("dropout", "motor_trip"):
        share = rng.uniform(0.12, 0.25)
        switched = {"delay_s": rng.uniform(0.02, 0.06), "voltage": rng.uniform(0.68, 0.8)}
        if kind == "dropout":
            kpm = rng.uniform(0.3, 0.45)
            records = [
                motor_record("M1", bus, kpm, m),
                static_record("L1", bus, (1 - kpm - share, 1 - kpm), z),
                static_record("X1", bus, (share, 0.0), (0.0, 0.0, 0.0, 0.0)),
            ]
        else:
            kpm = rng.uniform(0.35, 0.5)
            share = kpm * rng.uniform(0.3, 0.5)
            records = [
                motor_record("M1", bus, kpm - share, m),
                motor_record("X1", bus, share, m),
                static_record("L1", bus, (1 - kpm, 1 - kpm), z),
            ]
        more = {"share": share, **switched}
    elif kind in ("generation", "generation_trip"):
        fed = generation(rng)
        switched = opening(rng) if kind == "generation_trip" else None
        more = {"generation": fed, **(switched or {})}
    if records is None:
        records = [motor_record("M1", bus, kpm, m), static_record("L1", bus, (1 - kpm, 1 - kpm), z)]
    truth = {"kpm": kpm, "motor": m, "zip": z, **more}
    return {"records": records, "behind": behind, "switched": switched, "generation": fed, "truth": truth}


def pair(kind, rng):
    """The load of a site with two effects of `PARTS`, as `site` gives it."""
    parts = kind.split("+")
    kpm, m, z = rng.uniform(0.35, 0.5), motor(rng), zip_shares(rng)
    static_p, static_q, by_frequency = 1 - kpm, 1 - kpm, (0.0, 0.0)
    behind, bus, switched, fed, more = None, "L", None, None, {}
    records, motors = [], {"M1": (kpm, m)}
    if "feeder" in parts:
        behind, bus = {"kv": 23.0, "r_ohm": rng.uniform(0.05, 0.12), "x_ohm": rng.uniform(0.2, 0.35)}, "D"
    if "torque" in parts:
        m["A"] = 1.0
    if "second_motor" in parts:
        second, share = motor(rng), kpm * rng.uniform(0.4, 0.6)
        m["h"], m["rr"] = rng.uniform(0.2, 0.4), rng.uniform(0.025, 0.04)
        second.update(h=rng.uniform(1.2, 1.8), rr=rng.uniform(0.008, 0.013))
        motors = {"M1": (kpm - share, m), "M2": (share, second)}
        more |= {"motor2": second, "share2": share}
    if "frequency" in parts:
        by_frequency = rng.uniform(1.5, 3.0), -rng.uniform(1.0, 2.5)
        more |= {"dp": by_frequency[0], "dq": by_frequency[1]}
    if "recovery" in parts:
        share, time_s = rng.uniform(0.15, 0.3), rng.uniform(1.2, 4.0)
        static_p -= share
        records.append(f"INJEC RESTLD X2 {bus} {share:.6f} 0. 0. 0. 0. 2. 0. 0.2 3. 0. 2. 0. 0.2 3. {time_s:.3f} ;")
        more |= {"recovering": share, "tr": time_s}
    if "dropout" in parts or "motor_trip" in parts:
        switched = {"delay_s": rng.uniform(0.02, 0.06), "voltage": rng.uniform(0.68, 0.8)}
        if "dropout" in parts:
            share = rng.uniform(0.1, 0.2)
            static_p -= share
            records.append(static_record("X1", bus, (share, 0.0), (0.0, 0.0, 0.0, 0.0)))
        else:
            share = kpm * rng.uniform(0.2, 0.4)
            motors = {name: (own * (1 - share / kpm), machine) for name, (own, machine) in motors.items()}
            motors["X1"] = share, m
        more |= {"share": share, **switched}
    if "generation_trip" in parts:
        fed, switched = generation(rng), opening(rng)
        more |= {"generation": fed, **switched}
    records += [motor_record(name, bus, own, machine) for name, (own, machine) in motors.items()]
    records.append(static_record("L1", bus, (static_p, static_q), z, by_frequency, local="frequency" in parts))
    truth = {"kpm": kpm, "motor": m, "zip": z, **more}
    return {"records": records, "behind": behind, "switched": switched, "generation": fed, "truth": truth}


def network(p_mw, q_mvar, behind, fed_mw):
    """Records of buses, lines, transformers and, for the load flow, generators; P is less what inverters feed at bus I."""
    records = [
        "BUS B1 225. 0 0 0 0 ;",
        "BUS B2 225. 250. 60. 0 0 ;",
        "BUS B3 225. 200. 40. 0 0 ;",
        "BUS B4 225. 0 0 0 0 ;",
        "BUS B5 225. 150. 30. 0 0 ;",
        *(f"BUS {name} 15. 0 0 0 0 ;" for name, *_ in MACHINES),
    ]
    load = f"{p_mw + fed_mw:.5f} {q_mvar:.5f} 0 0 ;"
    if behind:
        records += ["BUS L 23. 0 0 0 0 ;", f"BUS D {behind['kv']} {load}"]
    else:
        records.append(f"BUS L 23. {load}")
    lines = [
        ("B1-B2", "B1 B2 3. 30. 150."),
        ("B2-B3", "B2 B3 2.5 25. 120."),
        ("B3-B4", "B3 B4 1.5 16. 80."),
        ("B3-B4b", "B3 B4 1.5 16. 80."),
        ("B4-B5", "B4 B5 2. 22. 100."),
        ("B1-B5", "B1 B5 3. 32. 150."),
    ]
    records += [f"LINE {name} {values} 1350. 1 ;" for name, values in lines]
    ratio = 98.0 if behind and "ltc" in behind else 97.0
    records += [
        "TRANSFO G1-B1 G1 B1 0. 12. 0. 0. 104. 0. 900. 1 ;",
        "TRANSFO G2-B5 G2 B5 0. 13. 0. 0. 104. 0. 500. 1 ;",
        "TRANSFO G3-B3 G3 B3 0. 13. 0. 0. 104. 0. 150. 1 ;",
        f"TRANSFO L-B4 L B4 0. 14. 0. 0. {ratio} 0. 300. 1 ;",
    ]
    if behind and "ltc" in behind:
        records.append(f"TRANSFO D-L D L 0.5 {behind['x_percent']} 0. 0. 100.0 0. 250. 1 ;")
    elif behind:
        records.append(f"LINE feeder L D {behind['r_ohm']} {behind['x_ohm']} 0. 2000. 1 ;")
    if fed_mw:
        records += [f"BUS I 23. {-fed_mw:.5f} 0 0 0 ;", "LINE inverters L I 0. 0.002 0. 2000. 1 ;"]
    return records + [
        "GENER G1 G1 0. 0. 1.02 900. -9999 9999 1 ;",
        "GENER G2 G2 300. 0. 1.01 500. -9999 9999 1 ;",
        "GENER G3 G3 80. 0. 1.0 150. -9999 9999 1 ;",
        "SLACK G1 ;",
    ]


def load_flow(records):
    """Phasor of every bus, by Newton's method, in the conventions of STEPSS."""
    kv, power, held, branches, slack = {}, {}, {}, [], None
    for record in records:
        kind, *words = record.split()
        if kind == "BUS":
            kv[words[0]] = float(words[1])
            power[words[0]] = -complex(float(words[2]), float(words[3])) / NETWORK_BASE_MVA
        elif kind == "LINE":
            ohm = kv[words[1]] ** 2 / NETWORK_BASE_MVA
            series = ohm / complex(float(words[3]), float(words[4]))
            branches.append((words[1], words[2], series, 1e-6j * float(words[5]) * ohm, 1.0))
        elif kind == "TRANSFO":
            series = float(words[9]) / complex(float(words[3]), float(words[4])) * 100.0 / NETWORK_BASE_MVA
            branches.append((words[1], words[2], series, 0.0, float(words[7]) / 100.0))
        elif kind == "GENER":
            held[words[1]] = float(words[2]) / NETWORK_BASE_MVA, float(words[4])
        elif kind == "SLACK":
            slack = words[0]
    at = {bus: i for i, bus in enumerate(kv)}
    admittance = np.zeros((len(at), len(at)), complex)
    for one, other, series, shunt, ratio in branches:
        i, k = at[one], at[other]
        admittance[i, i] += series + shunt
        admittance[k, k] += series / ratio**2 + shunt
        admittance[i, k] -= series / ratio
        admittance[k, i] -= series / ratio
    admittance[at["B3"], at["B3"]] += 0.6j  # the capacitor SH3
    injected = np.array([power[bus] for bus in at])
    modulus = np.ones(len(at))
    for bus, (active, voltage) in held.items():
        modulus[at[bus]] = voltage
        injected[at[bus]] += active
    controlled = [at[bus] for bus in held if bus != slack]
    loads = [i for i in range(len(at)) if i != at[slack] and i not in controlled]
    turning = controlled + loads

    def mismatch(unknowns):
        angle, v = np.zeros(len(at)), modulus.copy()
        angle[turning], v[loads] = unknowns[: len(turning)], unknowns[len(turning) :]
        u = v * np.exp(1j * angle)
        over = u * np.conj(admittance @ u) - injected
        return np.concatenate([over.real[turning], over.imag[loads]]), u

    unknowns = np.concatenate([np.zeros(len(turning)), np.ones(len(loads))])
    for _ in range(30):
        left, _ = mismatch(unknowns)
        if abs(left).max() < 1e-11:
            break
        step = 1e-7 * np.eye(len(unknowns))
        slopes = np.array([(mismatch(unknowns + d)[0] - left) / 1e-7 for d in step]).T
        unknowns = unknowns - np.linalg.solve(slopes, left)
    return dict(zip(at, mismatch(unknowns)[1]))


def dynamics(load, fed_mw):
    """Records of machines, loads and shunts."""
    records = []
    for name, mva, mw, inertia_s in MACHINES:
        records.append(
            f"SYNC_MACH {name} {name} 1. 1. 0. 0. {mva}. {mw}. {inertia_s} 0. 2.05\n"
            " XT 0.15 2.2 0.3 0.2 2. 0.4 0.2 0. 6.0257 0. 7.00 0.05 1.5 0.05\n"
            " EXC exc_GENERIC 70. 1. 1. 0.40 0. 5.\n"
            " 50. 5. 0.323 0.0138 0.323 0.0138 0.06\n"
            " 2.90 1.00 8.0 2.0 -1.10 0.10 0.20\n"
            " TOR THERMAL_GENERIC1 0.04 0.10 0.40 -0.05 0.05 0.0 1.0 0.3 0.4 5.0 0.3 0.3 ;"
        )
    records += [f"INJEC LOAD R{b} {b} 1. 1. 0. 0. 0. 1. 2. 0. 1. 1. 0. 1. 2. 0. 1. 1. ;" for b in ("B2", "B3", "B5")]
    records += load["records"]
    if fed_mw:
        records.append(generation_record("X1", "I", fed_mw, load["generation"]["current_limit"]))
    if load["behind"] and "ltc" in load["behind"]:
        records.append(load["behind"]["ltc"])
    return records + ["SHUNT SH3 B3 60. 1 ;", "SHUNT SH4 B4 0.001 1 ;", "FNOM 60 ;"]


SETTINGS = """\
$NEWTON_TOLER 0.00001 0.00001 0.00001 ;
$FIN_DIFFER 0.00001 0.00001 ;
$PLOT_STEP 0.001 ;
$DISP_PROF F ;
$NB_THREADS 1 ;
$T_LOAD_REST 0.005 ;
$FULL_UPDATE F ;
$SKIP_CONV F ;
$LATENCY 20. F ;
$SCHEME DE ;
$OMEGA_REF COI ;
$SPARSE_SOLVER KLU ;
"""


def disturbances(event):
    """The simulator's list of what happens, in order of time."""
    at_s, kind, cycles = event["t"], event["kind"], event["cycles"]

    def fault(begin_s):
        end_s = begin_s + cycles / NOMINAL_HZ
        return [
            (begin_s, f"FAULT BUS {event['bus']} 0. {event.get('xf', 0.0):.4f}"),
            (end_s, f"CLEAR BUS {event['bus']}"),
        ]

    opened = "BREAKER BRANCH B3-B4 0 0"
    happens = {
        "fault": lambda: fault(at_s),
        "fault+trip": lambda: [*fault(at_s), (at_s + cycles / NOMINAL_HZ, opened)],
        "double": lambda: fault(at_s) + fault(at_s + 0.5 + cycles / NOMINAL_HZ),
        "line": lambda: [(at_s, opened)],
        "gen": lambda: [(at_s, "BREAKER SYNC_MACH G3 0")],
        "capout": lambda: [(at_s, "CHGPRM SHUNT SH3 QNOM -60.")],
        "cap": lambda: [(at_s, "CHGPRM SHUNT SH4 QNOM +50.")],
    }[kind]()
    happens += [(time_s, "BREAKER INJ X1 0") for time_s in event.get("trips", [])]
    happens = [(round(time_s, 4), what) for time_s, what in happens]
    happens.sort(key=lambda pair: pair[0])
    lines = [f"{time_s:.4f} {what}" for time_s, what in happens]
    return "\n".join(["0.000 CONTINUE SOLVER BD 0.0005 0.0001 0. ABL", *lines, f"{event['end']:.3f} STOP", ""])


def simulate(load, event, p_mw, q_mvar, fed_mw):
    """Time, complex voltage at the measured bus L in the nominal frame, and complex power into the load, pu of 100 MVA."""
    records = network(p_mw, q_mvar, load["behind"], fed_mw)
    solved = load_flow(records)
    flow = [r for r in records if not r.startswith(("GENER", "SLACK"))]
    flow += [f"LFRESV {bus} {abs(u):.10f} {np.angle(u):.10f} ;" for bus, u in solved.items()]
    with tempfile.TemporaryDirectory() as folder:
        case = stepss.cfg()
        inputs = {"flow": "\n".join(flow) + "\n", "dynamics": "\n".join(dynamics(load, fed_mw)) + "\n", "settings": SETTINGS}
        for name, text in inputs.items():
            with open(f"{folder}/{name}.dat", "w", encoding="ascii") as file:
                file.write(text)
        for name in ("dynamics", "flow", "settings"):
            case.addData(f"{folder}/{name}.dat")
        with open(f"{folder}/event.dst", "w", encoding="ascii") as file:
            file.write(disturbances(event))
        with open(f"{folder}/observed.dat", "w", encoding="ascii") as file:
            file.write("BUS *\nSYNC *\nINJEC *\nBRANCH *\n")
        case.addDst(f"{folder}/event.dst")
        case.addObs(f"{folder}/observed.dat")
        case.addTrj(f"{folder}/course.trj")
        for add, name in ((case.addInit, "init"), (case.addCont, "cont"), (case.addDisc, "disc"), (case.addOut, "out")):
            add(f"{folder}/{name}.trace")
        stepss.sim().execSim(case)
        course = stepss.extractor(f"{folder}/course.trj")
        bus = course.getBus("L")
        time_s, modulus = np.array(bus.mag.time), np.array(bus.mag.value)
        angle = np.unwrap(np.radians(np.array(bus.pha.value)))
        speed = centre_of_inertia(course, event, time_s)
        if load["behind"] and "ltc" not in load["behind"]:
            branch, sign = course.getBranch("feeder"), 1.0
        else:
            branch, sign = course.getBranch("L-B4"), -1.0
        power = sign * (np.array(branch.PF.value) + 1j * np.array(branch.QF.value)) / NETWORK_BASE_MVA
    # Before and behind a jump the simulator gives the same time.
    time_s = time_s + 1e-12 * np.arange(len(time_s))
    return time_s, modulus, angle, speed, power


def centre_of_inertia(course, event, time_s):
    """Speed of the frame in which the simulator gives angles, pu."""
    speeds = np.array([np.array(course.getSync(name).S.value) for name, *_ in MACHINES])
    weights = np.array([[mva * inertia_s] for _, mva, _, inertia_s in MACHINES]) * np.ones_like(speeds)
    if event["kind"] == "gen":
        weights[2] *= time_s < event["t"]
    return (speeds * weights).sum(0) / weights.sum(0)


def phasors(course):
    """Complex voltage and current on the even grid, in the frame that turns at the nominal frequency."""
    time_s, modulus, angle, speed, power = course
    grid = even_grid(time_s)
    speed = np.interp(grid, time_s, speed)
    turned = 2 * np.pi * NOMINAL_HZ * GRID_S * np.concatenate([[0], np.cumsum((speed[1:] + speed[:-1]) / 2 - 1)])
    voltage = np.interp(grid, time_s, modulus) * np.exp(1j * (np.interp(grid, time_s, angle) + turned))
    current = np.conj((np.interp(grid, time_s, power.real) + 1j * np.interp(grid, time_s, power.imag)) / voltage)
    return voltage, current, time_s[-1]


def draw_event(kind, bus, cycles, rng):
    event = {"kind": kind, "bus": bus, "cycles": cycles, "t": rng.uniform(1.4, 1.9), "end": float(rng.choice([10.0, 12.0]))}
    if (bus, cycles) in FAULT_REACTANCE_OHM:
        event["xf"] = rng.uniform(*FAULT_REACTANCE_OHM[(bus, cycles)])
    return event


def relay_operates_s(time_s, is_below, delay_s):
    """When a definite-time relay operates: the voltage has been below for the delay without a break. None where it never is."""
    begun_s = None
    for now_s, below in zip(time_s, is_below):
        if not below:
            begun_s = None
        elif begun_s is None:
            begun_s = now_s
        if begun_s is not None and now_s - begun_s >= delay_s:
            return begun_s + delay_s
    return None


def main():
    kind, folder, frames_per_s, noise, rng = arguments(__doc__, KINDS)
    parts = kind.split("+")
    both = kind != "feeder+second_motor" and len(parts) == 2
    load = pair(kind, rng) if both else site(kind, rng)
    os.makedirs(folder, exist_ok=True)
    p_mw, q_mvar = rng.uniform(150, 195), rng.uniform(40, 62)
    fed_mw = load["generation"]["share"] * p_mw if load["generation"] else 0.0
    if fed_mw:
        load["truth"]["fed_mw"] = fed_mw
    written = []
    for number in rng.permutation(len(EVENTS)):
        event = draw_event(*EVENTS[number], rng)
        of_day = rng.uniform(0.88, 1.12)
        at = p_mw * of_day, q_mvar * of_day * rng.uniform(0.91, 1.09), fed_mw
        try:
            course = simulate(load, event, *at)
            if load["switched"] and "xf" in event:
                opens_s = relay_operates_s(course[0], course[1] < load["switched"]["voltage"], load["switched"]["delay_s"])
                if opens_s is not None:
                    event["trips"] = [opens_s]
                    course = simulate(load, event, *at)
        except stepss.globals.RAMSESError as error:
            print(f"{folder}: no {event['kind']}: {error}", file=sys.stderr)
            continue
        name = write_event(folder, len(written) + 1, measure(*phasors(course), frames_per_s, noise, rng))
        written.append({"file": name, **event, "v_min": float(course[1].min())})
    # A block of constant power that stays off is either.
    either = ["self_disconnection"] if "dropout" in parts else []
    truth = {"effects": KINDS[kind], "equally_right": either, "parameters": load["truth"], "noise": noise, "events": written}
    write_site(folder, frames_per_s, 23.0, truth)


if __name__ == "__main__":
    main()
