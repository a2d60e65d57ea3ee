"""A PMU of the PyPI package `synchrophasor`, for the tests.

    pmu.py PORT START_S FORMAT...      FORMAT: polarfloat, rectfloat, polarint, rectint

For each FORMAT 900 frames at 30 frames/s, stamped from START_S + 1/60 on (seconds since 1970, an hour apart), with
a dip to 0.7 of the voltage in the frames 450 to 479. From one format to the next it sends its new configuration
in between, without closing. Writes the port on its first line and `sent` on its second; then it stays.
"""

import collections
import collections.abc
import math
import select
import signal
import struct
import sys
import time

# synchrophasor 1.0.0a0 was written before Python 3.10 took this name away.
collections.Sequence = collections.abc.Sequence

import synchrophasor.pmu as package  # noqa: E402
from synchrophasor.frame import ConfigFrame2, DataFrame  # noqa: E402

ID_CODE, RATE, FRAMES, DIP = 7, 30, 900, range(450, 480)
VOLTS_PER_BIT, AMPERES_PER_BIT = 1000, 100  # in 1e-5 V and 1e-5 A, as PHUNIT has them
STATUS = ("ok", True, "timestamp", False, False, False, 0, "<10", 0)


def frequency_as_sent(frequency, data_format):
    """The package refuses a floating-point frequency beyond +-32.767, which every frequency in Hz is."""
    is_float = data_format & 8 if isinstance(data_format, int) else data_format[3]
    if is_float:
        return struct.unpack("!I", struct.pack("!f", frequency))[0]
    return struct.unpack("!H", struct.pack("!h", frequency))[0]


DataFrame._freq2int = staticmethod(frequency_as_sent)
# The package waits before each frame, and not at all for commands; the stamps say the time here.
package.sleep = lambda seconds: None
package.select = lambda reads, writes, errors, _: select.select(reads, writes, errors, 0.0005)


def configuration(name):
    polar, is_float = name.startswith("polar"), name.endswith("float")
    channels = ["VA", "IA", *[f"contact {bit}" for bit in range(16)]]
    return ConfigFrame2(
        ID_CODE, 1000000, 1, "Load bus 1", ID_CODE, (polar, is_float, is_float, is_float), 2, 0, 1, channels,
        [(VOLTS_PER_BIT, "v"), (AMPERES_PER_BIT, "i")], [], [(0, 0xFFFF)], 50, 1, RATE,
    )


def frame(name, cfg, start_s, k):
    polar, is_float = name.startswith("polar"), name.endswith("float")
    share = 0.7 if k in DIP else 1.0
    phasors = []
    for magnitude, angle, per_bit in [(57.7 * share, 0.1, VOLTS_PER_BIT), (5.0 * share, -0.4, AMPERES_PER_BIT)]:
        if not is_float:
            magnitude /= per_bit * 1e-5
        first, second = magnitude, angle
        if not polar:
            first, second = magnitude * math.cos(angle), magnitude * math.sin(angle)
        if not is_float:
            first, second = round(first), round(second * 1e4 if polar else second)
        phasors.append((first, second))
    frequency, change = (50.01, 0.0) if is_float else (10, 0)
    # Half a period later than the second: the package takes a fraction of 0 for none, and puts its clock's.
    microseconds = round((k + 0.5) * 1e6 / RATE)
    second, fraction = divmod(microseconds, 1000000)
    return DataFrame(ID_CODE, STATUS, phasors, frequency, change, [], [0x3C12], cfg, start_s + second, fraction)


def main():
    # So that the processes that hold connections end with this one.
    signal.signal(signal.SIGTERM, lambda *_: sys.exit(0))
    port, start_s, names = int(sys.argv[1]), int(sys.argv[2]), sys.argv[3:]
    pmu = package.Pmu(ip="127.0.0.1", port=port, pmu_id=ID_CODE, data_rate=RATE, set_timestamp=False)
    pmu.logger.setLevel("ERROR")
    pmu.set_configuration(configuration(names[0]))
    pmu.run()
    print(pmu.socket.getsockname()[1], flush=True)
    while not pmu.client_buffers:
        time.sleep(0.01)
    for at, name in enumerate(names):
        cfg = configuration(name)
        if at > 0:
            pmu.send(cfg)
        for k in range(FRAMES):
            # As bytes: what is sent is what was made here.
            pmu.send(frame(name, cfg, start_s + 3600 * at, k).convert2bytes())
    print("sent", flush=True)
    time.sleep(3600)


if __name__ == "__main__":
    main()
