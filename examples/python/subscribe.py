"""Prints the parameter sets in force, then each as it is published: subscribe.py [ENDPOINT [SITE]]."""
import json, sys, zenoh  # PyPI: eclipse-zenoh

def show(payload):
    s = json.loads(payload.to_string())
    values = ", ".join(f"{name} = {p['value']} {p['unit']}" for name, p in s["parameters"].items())
    print(f"{s['site']} version {s['version']} ({s['verdict']['status']}): {values}", flush=True)

key = f"loadmodel/v1/parameters/{sys.argv[2] if len(sys.argv) > 2 else '*'}"
config = zenoh.Config()
config.insert_json5("mode", '"client"')
config.insert_json5("connect/endpoints", json.dumps([sys.argv[1] if len(sys.argv) > 1 else "tcp/127.0.0.1:7447"]))
with zenoh.open(config) as session, session.declare_subscriber(key) as subscriber:
    for payload in [reply.ok.payload for reply in session.get(key) if reply.ok]:
        show(payload)
    for sample in subscriber:
        show(sample.payload)
