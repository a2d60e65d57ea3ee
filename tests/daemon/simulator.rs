//! A PMU that others have written (the `PyPI` package `synchrophasor`), in its four formats, through the bridge and
//! zenoh into the daemon: each dip is one window with its depth and its time, whether the configuration changes
//! while the PMU runs or because another one takes its place.

use super::*;

const START_S: i64 = 1_767_225_600;
const HOUR_S: i64 = 3600;
/// Frames of one format.
const FRAMES: u64 = 900;
/// Time of the first frame of its dip: 450 periods of a thirtieth of a second, and a half.
const DIP_NS: i64 = 15_016_666_667;

#[test]
#[allow(clippy::too_many_lines, reason = "one history from start to end")]
fn a_pmu_of_another_make_is_followed_through_its_formats_and_a_restart() {
    let Some(python) = python() else { return };
    let mapping = "[[site.c37118]]\nvoltage = [\"VA\"]\ncurrents = [\"IA\"]\n\
                   voltage_ratio = 1100\ncurrent_ratio = 200\n";
    let place = Place::of_site(mapping);
    let daemon = place.start();
    let first = Simulator::start(&python, 0, START_S, &["polarfloat", "rectint"]);
    let source = format!("127.0.0.1:{}", first.port);
    let mut bridge = Process::start(&[
        "bridge",
        "c37118",
        &source,
        "--id-code",
        "7",
        "--site",
        SITE,
        "--endpoint",
        &daemon.endpoint,
        "--pause-s",
        "1",
        // What is sent takes less time than it stands for, and then nothing comes.
        "--silence-s",
        "3600",
    ]);
    wait_for_samples(&daemon, 2 * FRAMES);
    let port = first.port;
    drop(first);
    let _second = Simulator::start(
        &python,
        port,
        START_S + 2 * HOUR_S,
        &["rectfloat", "polarint"],
    );
    wait_for_samples(&daemon, 4 * FRAMES);

    let events = wait_for("the windows", || {
        let events: Value = serde_json::from_str(&daemon.get("/api/v1/events").1).ok()?;
        let events = events.as_array()?.clone();
        (events.len() == 4).then_some(events)
    });
    // Newest first.
    for (event, hour) in events.iter().rev().zip(0..) {
        let expected_ns = (START_S + hour * HOUR_S) * 1_000_000_000 + DIP_NS;
        let off_ns = event["onset_ns"].as_i64().unwrap() - expected_ns;
        assert!(
            off_ns.abs() < 10_000,
            "stamps are whole microseconds: {event}"
        );
        // 0.7 of 57.7 V by 1100 of 110 kV; an integer has steps of 0.01 V.
        let expected = 0.7 * 57.7 * 1.1 * 3.0_f64.sqrt() / 110.0;
        let lowest = event["lowest_voltage_pu"].as_f64().unwrap();
        let tolerance = if hour % 2 == 0 { 1e-5 } else { 3e-4 };
        assert!(
            (lowest - expected).abs() < tolerance,
            "{lowest}, not {expected}"
        );
    }

    // Frames are reported once a second.
    for (outcome, count) in [("sample", 4 * FRAMES), ("reconfiguration", 3)] {
        let line = format!(
            "loadmodeld_frames_total{{outcome=\"{outcome}\",site=\"{SITE}\",stream=\"*\"}} {count}\n"
        );
        wait_for(&line, || {
            daemon.get("/metrics").1.contains(&line).then_some(())
        });
    }
    let metrics = daemon.get("/metrics").1;
    for outcome in [
        "not_as_configured",
        "malformed",
        "bad_checksum",
        "not_mapped",
    ] {
        assert!(
            !metrics.contains(&format!("outcome=\"{outcome}\"")),
            "{outcome}"
        );
    }
    terminate(&bridge.child);
    let counts: Value = serde_json::from_str(&bridge.lines.recv_timeout(LIMIT).unwrap()).unwrap();
    assert!(bridge.child.wait().unwrap().success());
    let of = |name: &str| counts[name].as_u64().unwrap();
    assert_eq!((of("connections"), of("broken")), (2, 1), "{counts}");
    assert_eq!(
        (of("data"), of("reconfigurations")),
        (4 * FRAMES, 3),
        "{counts}"
    );
    let lost = [
        "dropped",
        "unpublished",
        "skipped_bytes",
        "not_as_configured",
        "malformed",
    ];
    assert_eq!(lost.map(of), [0; 5], "{counts}");
    assert!(daemon.terminate().success());
}

fn wait_for_samples(daemon: &Daemon, count: u64) {
    let line =
        format!("loadmodeld_samples_total{{outcome=\"accepted\",site=\"{SITE}\"}} {count}\n");
    wait_for(&line, || {
        daemon.get("/metrics").1.contains(&line).then_some(())
    });
}

/// A Python that has the package; none, and said so, elsewhere.
fn python() -> Option<std::ffi::OsString> {
    let python = std::env::var_os("LOADMODELD_TEST_PYTHON").unwrap_or_else(|| "python3".into());
    let tried = Command::new(&python)
        .args(["-c", "import collections, collections.abc as a; collections.Sequence = a.Sequence; import synchrophasor.pmu"])
        .stderr(Stdio::null())
        .status();
    if tried.is_ok_and(|status| status.success()) {
        return Some(python);
    }
    println!("SKIPPED: the PMU of another make (no Python with the PyPI package synchrophasor)");
    None
}

/// `pmu.py` as a process; it ends with the test.
struct Simulator {
    child: Child,
    port: u16,
}

impl Simulator {
    #[allow(
        clippy::zombie_processes,
        reason = "one that gives no port ends the test's process with it"
    )]
    fn start(python: &std::ffi::OsStr, port: u16, start_s: i64, formats: &[&str]) -> Self {
        let script = Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/daemon/pmu.py");
        let mut child = Command::new(python)
            .arg(script)
            .args([port.to_string(), start_s.to_string()])
            .args(formats)
            .stdout(Stdio::piped())
            .spawn()
            .unwrap();
        let lines = lines_of(child.stdout.take().unwrap());
        let line = lines.recv_timeout(LIMIT).expect("the PMU's port");
        let port = line.parse().unwrap_or_else(|_| panic!("{line}"));
        Self { child, port }
    }
}

impl Drop for Simulator {
    /// Asked to end, it takes the process with it that holds the connection; killed, it would not.
    fn drop(&mut self) {
        terminate(&self.child);
        // It may have ended already.
        drop(self.child.wait());
    }
}

impl Place {
    /// A site on the base of the PMU's load.
    fn of_site(more: &str) -> Self {
        let place = Self::with("");
        let path = place.directory.path().join("config.toml");
        let text = fs::read_to_string(&path).unwrap();
        let text = text.replace(
            "s_base_mva = 200\nv_base_kv = 23\nnominal_hz = 60",
            "s_base_mva = 190\nv_base_kv = 110\nnominal_hz = 50",
        );
        let text = text.replace(
            "[measurement]\n",
            "[detection]\npost_trigger_s = 3\n[measurement]\n",
        );
        fs::write(path, text + more).unwrap();
        place
    }
}

fn terminate(child: &Child) {
    let id = child.id().to_string();
    let sent = Command::new("kill").args(["-TERM", &id]).status();
    assert!(sent.unwrap().success());
}
