#!/usr/bin/env python3
"""Fills a store for tests/web/speed.mjs: clones of one site's events and sets.

    fill.py STORE SITE

A site `many` with 5,000 events and 99 sites `clone-01` ... with 20 events each, without waveforms, every
one of them in the set in force that SITE has.
"""
import sqlite3
import sys

MANY, SITES, EVENTS = 5000, 99, 20

store, site = sys.argv[1:]
base = sqlite3.connect(store, timeout=30)


def columns(table, **replaced):
    """Names of all columns, and what stands for each."""
    names = [row[1] for row in base.execute(f"PRAGMA table_info({table})")]
    return ", ".join(names), ", ".join(replaced.get(name, name) for name in names)


def clone(name, events):
    into, what = columns("sites", name=":name")
    base.execute(f"INSERT INTO sites ({into}) SELECT {what} FROM sites WHERE name = :site", {"name": name, "site": site})
    first = base.execute("SELECT id FROM windows WHERE site = ? ORDER BY id", (site,)).fetchall()
    for number in range(events):
        source = first[number % len(first)][0]
        values = {"id": f"{name}-{number:05}", "name": name, "source": source, "shift": number * 3600 * 10**9}
        into, what = columns("windows", id=":id", site=":name", onset_ns="onset_ns + :shift", start_ns="start_ns + :shift")
        base.execute(f"INSERT INTO windows ({into}) SELECT {what} FROM windows WHERE id = :source", values)
        into, what = columns("screenings", window_id=":id")
        base.execute(f"INSERT INTO screenings ({into}) SELECT {what} FROM screenings WHERE window_id = :source", values)
    into, what = columns("parameter_sets", site=":name")
    base.execute(f"INSERT INTO parameter_sets ({into}) SELECT {what} FROM parameter_sets WHERE site = :site", {"name": name, "site": site})


with base:
    clone("many", MANY)
    for number in range(1, SITES + 1):
        clone(f"clone-{number:02}", EVENTS)
print(f"{MANY} events, {SITES + 2} sites")
