"""Publishes the events of a site folder as sample batches (JSON). Needs eclipse-zenoh.

publish.py FOLDER [--endpoint tcp/127.0.0.1:7447] [--stream NAME] [--speed 1]

A speed of 1 keeps the recording's own timing within an event, 10 is ten times as fast, 0 does not wait.
The pauses between events are left out. The format is described in docs/wire-format.md.
"""
import argparse
import csv
import datetime
import json
import pathlib
import time

import zenoh

SECOND_NS = 1_000_000_000
# Column of the folder -> channel and unit of the wire.
CHANNELS = {
    "v_pu": ("voltage", "pu"),
    "angle_deg": ("angle", "deg"),
    "freq_hz": ("frequency", "Hz"),
    "p_pu": ("active_power", "pu"),
    "q_pu": ("reactive_power", "pu"),
}
STAT_DATA_INVALID = 0x8000


def number(text):
    """The number, or None (null) for a cell that holds none: JSON has no NaN."""
    try:
        value = float(text)
    except (TypeError, ValueError):
        return None
    return value if abs(value) < float("inf") else None


def rows(file):
    """Rows with a readable time."""
    with open(file, newline="", encoding="utf-8") as lines:
        return [row for row in csv.DictReader(lines) if number(row.get("time_s")) is not None]


def runs(table, rate_fps):
    """Runs of rows without a gap, of one second at most."""
    run = []
    for row in table:
        if run:
            expected_s = number(run[0]["time_s"]) + len(run) / rate_fps
            gap = abs(number(row["time_s"]) - expected_s) > 0.5 / rate_fps
            if gap or len(run) >= rate_fps:
                yield run
                run = []
        run.append(row)
    if run:
        yield run


def batch(site, stream, sequence, origin_ns, run):
    """One sample batch."""
    stat = [number(row.get("stat", "0")) for row in run]
    return {
        "v": 1,
        "site": site["site"],
        "stream": stream,
        "sequence": sequence,
        "start_ns": origin_ns + round(number(run[0]["time_s"]) * SECOND_NS),
        "rate_fps": site["sample_rate_fps"],
        "nominal_hz": site["nominal_hz"],
        "channels": [
            {"channel": channel, "unit": unit, "values": [number(row[column]) for row in run]}
            for column, (channel, unit) in CHANNELS.items()
            if column in run[0]
        ],
        "quality": [STAT_DATA_INVALID if flags is None else int(flags) for flags in stat],
    }


def events(folder, site):
    """File and UTC nanoseconds of each event."""
    listed = site.get("events") or [
        {"file": file.name} for file in sorted(folder.glob("event_*.csv"))
    ]
    for at, event in enumerate(listed):
        # Without a time of its own, an event gets an hour of 2020.
        utc = event.get("utc", "2020-01-01T00:00:00Z").replace("Z", "+00:00")
        origin = datetime.datetime.fromisoformat(utc)
        shift_s = 0 if "utc" in event else 3600 * at
        yield folder / event["file"], (int(origin.timestamp()) + shift_s) * SECOND_NS


def main():
    """Reads the arguments and publishes."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("folder", type=pathlib.Path)
    parser.add_argument("--endpoint", default="tcp/127.0.0.1:7447")
    parser.add_argument("--stream", default="csv")
    parser.add_argument("--prefix", default="loadmodel/v1")
    parser.add_argument("--speed", type=float, default=1.0)
    arguments = parser.parse_args()
    site = json.loads((arguments.folder / "site.json").read_text(encoding="utf-8"))
    config = zenoh.Config()
    config.insert_json5("mode", '"client"')
    config.insert_json5("connect/endpoints", json.dumps([arguments.endpoint]))
    with zenoh.open(config) as session:
        publisher = session.declare_publisher(
            f"{arguments.prefix}/measurement/{site['site']}/{arguments.stream}",
            encoding=zenoh.Encoding.APPLICATION_JSON,
            # Wait instead of dropping silently, which is the default.
            congestion_control=zenoh.CongestionControl.BLOCK,
        )
        sequence = 0
        for file, origin_ns in events(arguments.folder, site):
            for run in runs(rows(file), site["sample_rate_fps"]):
                document = batch(site, arguments.stream, sequence, origin_ns, run)
                publisher.put(json.dumps(document, allow_nan=False))
                sequence += 1
                if arguments.speed > 0:
                    time.sleep(len(run) / site["sample_rate_fps"] / arguments.speed)
            print(f"{file.name}: published", flush=True)


if __name__ == "__main__":
    main()
