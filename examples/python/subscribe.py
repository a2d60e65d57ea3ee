"""Prints parameter sets as they are published: subscribe.py [ENDPOINT [SITE]]. Needs eclipse-zenoh."""
import json
import sys

import zenoh

endpoint = sys.argv[1] if len(sys.argv) > 1 else "tcp/127.0.0.1:7447"
key = f"loadmodel/v1/parameters/{sys.argv[2] if len(sys.argv) > 2 else '*'}"
config = zenoh.Config()
config.insert_json5("mode", '"client"')
config.insert_json5("connect/endpoints", json.dumps([endpoint]))
with zenoh.open(config) as session, session.declare_subscriber(key) as subscriber:
    for sample in subscriber:
        s = json.loads(sample.payload.to_string())
        values = ", ".join(f"{name} = {p['value']} {p['unit']}" for name, p in s["parameters"].items())
        print(f"{s['site']} version {s['version']} ({s['verdict']['status']}): {values}", flush=True)
