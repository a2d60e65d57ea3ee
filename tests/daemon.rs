//! The daemon as a process, on loopback: measurements go in over zenoh, parameter sets come out,
//! questions are answered, bad input is counted, kill -9 loses nothing, SIGTERM ends with 0.
#![allow(
    clippy::unwrap_used,
    clippy::expect_used,
    clippy::panic,
    clippy::print_stdout,
    reason = "a test that cannot go on should fail, and one that is left out should say so"
)]

#[path = "daemon/faults.rs"]
mod faults;
#[path = "daemon/killed.rs"]
mod killed;
#[path = "daemon/simulator.rs"]
mod simulator;

use std::{
    fs,
    io::{BufRead, BufReader, Read, Write},
    net::{SocketAddr, TcpStream},
    path::{Path, PathBuf},
    process::{Child, Command, ExitStatus, Stdio},
    sync::mpsc::{Receiver, channel},
    thread,
    time::Duration,
};

use loadmodeld::{
    adapters::{
        http::client::{Call, CallError},
        wire::v1::encode_batch_json,
        zenoh::{self, Encoding, Keys, Mode, Session, ZenohError, ZenohOptions},
    },
    daemon::clock,
    measurement::{Channel, Quality, SampleBatch},
};
use serde_json::Value;
use tempfile::TempDir;
use tokio::runtime::Runtime;

const PROGRAM: &str = env!("CARGO_BIN_EXE_loadmodeld");
/// The default prefix, which the Python example uses; every daemon has its own loopback port.
const PREFIX: &str = "loadmodel/v1";
const SITE: &str = "site-02";
/// The token of every daemon here.
const TOKEN: &str = "a-token-of-the-tests";
/// Events of the bundled site that are replayed: enough to fit on some and hold out others.
const EVENTS: [&str; 6] = ["03", "05", "06", "07", "08", "10"];
/// Longest wait for anything; generous, because a machine may be busy.
const LIMIT: Duration = Duration::from_mins(4);

#[test]
fn measurements_become_a_published_set_and_every_question_is_answered() {
    let place = Place::new();
    let daemon = place.start();
    let runtime = runtime();
    let session = runtime.block_on(daemon.session());
    let keys = Keys::new(PREFIX);
    let sets = runtime
        .block_on(zenoh::documents(&session, &keys.parameters("*")))
        .unwrap();
    let events = runtime
        .block_on(zenoh::documents(&session, &keys.event("*")))
        .unwrap();

    let python = PythonSubscriber::start(&daemon.endpoint);
    daemon.replay(&place.site_folder());

    let next = |documents: &zenoh::Documents| -> Value {
        let document = runtime.block_on(async {
            tokio::time::timeout(LIMIT, documents.next())
                .await
                .expect("a document in time")
        });
        serde_json::from_str(&document.unwrap()).unwrap()
    };
    for _ in EVENTS {
        let event = next(&events);
        assert_eq!(
            (&event["site"], &event["v"]),
            (&Value::from(SITE), &Value::from(1))
        );
    }
    let set = next(&sets);
    assert_eq!(
        (&set["site"], &set["version"]),
        (&Value::from(SITE), &Value::from(1))
    );
    assert_eq!(set["verdict"]["status"], "pass", "{set}");
    assert_eq!(
        set["structure"],
        serde_json::json!(["zip", "induction_motor"])
    );
    assert!(
        set["held_out"]["eps_p_percent"].as_f64().unwrap() < 1.0,
        "{set}"
    );

    questions_are_answered(&runtime, &session, &set);
    if let Some(python) = python {
        let line = python
            .lines
            .recv_timeout(LIMIT)
            .expect("a line of the subscriber");
        assert!(line.starts_with("site-02 version 1 (pass): M = "), "{line}");
    }

    let line = "loadmodeld_sets_published_total{site=\"site-02\"} 1";
    wait_for(line, || {
        daemon.get("/metrics").1.contains(line).then_some(())
    });
    assert_eq!(daemon.get("/healthz").0, 200);
    assert!(daemon.get("/").1.contains(SITE));
    let listed: Value = serde_json::from_str(&daemon.get("/api/v1/events").1).unwrap();
    assert_eq!(listed.as_array().unwrap().len(), EVENTS.len());
    assert!(daemon.terminate().success());
}

/// The latest set, one by version, refusals in words, and the status.
fn questions_are_answered(runtime: &Runtime, session: &Session, set: &Value) {
    let keys = Keys::new(PREFIX);
    let ask = |selector: String| {
        runtime.block_on(zenoh::ask(session, &selector, Duration::from_secs(30)))
    };
    let latest: Value = serde_json::from_str(&ask(keys.parameters(SITE)).unwrap()).unwrap();
    assert_eq!(latest, *set, "the answer is what was published");
    let first = ask(format!("{}?version=1", keys.parameters(SITE))).unwrap();
    assert_eq!(serde_json::from_str::<Value>(&first).unwrap(), *set);
    for (selector, words) in [
        (
            format!("{}?version=9", keys.parameters(SITE)),
            "no version 9",
        ),
        (
            format!("{}?version=x", keys.parameters(SITE)),
            "not a number",
        ),
        (keys.parameters("nowhere"), "no site `nowhere`"),
    ] {
        match ask(selector) {
            Err(ZenohError::Refused { reason, .. }) => assert!(reason.contains(words), "{reason}"),
            other => panic!("{other:?}"),
        }
    }
    let status: Value = serde_json::from_str(&ask(keys.status("*")).unwrap()).unwrap();
    assert_eq!(status["instance"], "tested");
}

#[test]
fn bad_input_is_refused_counted_and_survived() {
    let place = Place::new();
    let daemon = place.start();
    let runtime = runtime();
    let session = runtime.block_on(daemon.session());
    let keys = Keys::new(PREFIX);
    let put = |key: String, payload: Vec<u8>| {
        runtime
            .block_on(zenoh::put(
                &session,
                &key,
                payload,
                Encoding::APPLICATION_JSON,
            ))
            .unwrap();
    };
    let measurement = || keys.measurement(SITE, "pmu");
    put(measurement(), b"{\"v\": 1, \"site\":".to_vec());
    put(measurement(), vec![0xff; 64]);
    put(keys.measurement("nowhere", "pmu"), batch(|_| 1.0));
    put(format!("{PREFIX}/measurement/{SITE}"), batch(|_| 1.0));
    put(measurement(), batch(|_| f64::NAN));
    put(keys.recording(SITE, "dfr"), b"no recording".to_vec());
    put(measurement(), batch(|_| 0.0));

    for line in [
        "loadmodeld_payloads_refused_total{reason=\"malformed\",source=\"measurement\"} 2",
        "loadmodeld_payloads_refused_total{reason=\"unknown_site\",source=\"measurement\"} 1",
        "loadmodeld_payloads_refused_total{reason=\"stray_key\",source=\"measurement\"} 1",
        "loadmodeld_payloads_refused_total{reason=\"unknown_recorder\",source=\"recording\"} 1",
        "loadmodeld_batches_total{site=\"site-02\"} 2",
    ] {
        wait_for(line, || {
            daemon.get("/metrics").1.contains(line).then_some(())
        });
    }
    assert_eq!(daemon.get("/healthz").0, 200);
    assert!(
        !daemon.get("/metrics").1.contains("nowhere"),
        "no label comes from the network"
    );
    assert!(daemon.terminate().success());
}

#[test]
fn a_killed_daemon_loses_no_window_and_publishes_nothing_twice() {
    let place = Place::new();
    let mut daemon = place.start();
    daemon.replay(&place.site_folder());
    wait_for("all windows on storage", || {
        let (_, events) = daemon.get("/api/v1/events");
        let events: Value = serde_json::from_str(&events).ok()?;
        (events.as_array()?.len() == EVENTS.len()).then_some(())
    });
    daemon.child.kill().unwrap();
    daemon.child.wait().unwrap();

    let second = place.start();
    let set = second.wait_for_set();
    let (_, events) = second.get("/api/v1/events");
    let events: Value = serde_json::from_str(&events).unwrap();
    assert_eq!(events.as_array().unwrap().len(), EVENTS.len());
    assert!(second.terminate().success());

    let third = place.start();
    third.replay(&place.site_folder());
    wait_for("the windows", || {
        (third.windows_closed() == EVENTS.len()).then_some(())
    });
    let runtime = runtime();
    let session = runtime.block_on(third.session());
    wait_for("a daemon at rest", || {
        let selector = Keys::new(PREFIX).status("tested");
        let status = runtime
            .block_on(zenoh::ask(&session, &selector, LIMIT))
            .unwrap();
        let status: Value = serde_json::from_str(&status).unwrap();
        (status["at_rest"] == true).then_some(())
    });
    assert_eq!(third.wait_for_set(), set, "the same set is in force");
    let metrics = third.get("/metrics").1;
    assert!(
        !metrics.contains("loadmodeld_sets_published_total{"),
        "{metrics}"
    );
    assert!(!metrics.contains("loadmodeld_windows_total{"), "{metrics}");
    assert!(third.terminate().success());
}

#[test]
fn a_pmu_is_bridged_and_its_dips_become_the_windows_of_the_recording() {
    let mapping = "[[site.c37118]]\nvoltage = [\"V1\"]\ncurrents = [\"I1\"]\n";
    let place = Place::with(mapping);
    let folder = place.site_folder();
    let events = |bridged: bool| -> Vec<Value> {
        // A store of its own for each way.
        drop(fs::remove_file(place.directory.path().join("store.sqlite")));
        let daemon = place.start();
        let _processes = if bridged {
            let pmu = Process::start(&[
                "replay",
                &folder.display().to_string(),
                "--c37118",
                "0",
                "--id-code",
                "7",
                "--speed",
                "20",
            ]);
            let line = pmu.lines.recv_timeout(LIMIT).expect("the PMU's port");
            let address = line.strip_prefix("listening on ").unwrap().to_owned();
            let bridge = [
                "bridge",
                "c37118",
                &address,
                "--id-code",
                "7",
                "--site",
                SITE,
                "--endpoint",
                &daemon.endpoint,
            ];
            Some((pmu, Process::start(&bridge)))
        } else {
            daemon.replay(&folder);
            None
        };
        let events = wait_for("the windows", || {
            let (_, events) = daemon.get("/api/v1/events");
            let events: Vec<Value> = serde_json::from_str(&events).ok()?;
            (events.len() == EVENTS.len()).then_some(events)
        });
        if bridged {
            let metrics = daemon.get("/metrics").1;
            assert!(
                metrics.contains("{outcome=\"sample\",site=\"site-02\",stream=\"*\"}"),
                "{metrics}"
            );
            assert!(
                !metrics.contains("{outcome=\"not_as_configured\","),
                "{metrics}"
            );
        }
        assert!(daemon.terminate().success());
        events
    };
    let (direct, bridged) = (events(false), events(true));
    for (direct, bridged) in direct.iter().zip(&bridged) {
        assert_eq!(direct["onset_utc"], bridged["onset_utc"]);
        let lowest = |event: &Value| event["lowest_voltage_pu"].as_f64().unwrap();
        assert!(
            (lowest(direct) - lowest(bridged)).abs() < 1e-6,
            "{direct} {bridged}"
        );
    }
}

#[test]
fn a_real_recording_is_fitted_where_it_is_a_load_and_refused_where_it_is_transit() {
    let recording =
        Path::new(env!("CARGO_MANIFEST_DIR")).join("../shared/data/recordings/ru110/ru110.cfg");
    if !recording.exists() {
        let path = recording.display();
        println!("skipped: {path} is not here");
        return;
    }
    let place = Place::with(&format!(
        "{}{}",
        recorder("vl2", 10, "2СШ-110_ТН_110кВ", "2СШ-110_ВЛ_ВЛ2"),
        recorder("vl1", 100, "2СШ-110_ТН_110кВ", "2СШ-110_ВЛ_ВЛ1"),
    ));
    let daemon = place.start();
    for site in ["vl2", "vl1"] {
        daemon.command(
            "replay",
            &[&recording.display().to_string(), "--site", site],
        );
    }
    for line in [
        "loadmodeld_windows_screened_total{site=\"vl2\",verdict=\"usable\"} 1",
        "loadmodeld_windows_screened_total{site=\"vl1\",verdict=\"refused\"} 1",
        "loadmodeld_screening_refusals_total{reason=\"not_a_load\"} 1",
    ] {
        wait_for(line, || {
            daemon.get("/metrics").1.contains(line).then_some(())
        });
    }
    assert!(daemon.terminate().success());
}

#[test]
fn a_hidden_effect_is_named_and_once_it_is_added_a_better_set_is_published() {
    let place = Place::diagnosing(&site_table("demo2"));
    let daemon = place.start();
    let runtime = runtime();
    let session = runtime.block_on(daemon.session());
    let keys = Keys::new(PREFIX);
    let diagnoses = runtime
        .block_on(zenoh::documents(&session, &keys.diagnosis("demo2")))
        .unwrap();
    let next = || -> Value {
        let document = runtime.block_on(async {
            tokio::time::timeout(LIMIT, diagnoses.next())
                .await
                .expect("a diagnosis in time")
        });
        serde_json::from_str(&document.unwrap()).unwrap()
    };
    daemon.replay(&bundled("demo2"));

    let usable = daemon.usable_events(8);
    // Whatever was diagnosed before all events were there does not count.
    let first = loop {
        let diagnosis = next();
        if events_of(&diagnosis) == usable {
            break diagnosis;
        }
    };
    assert_eq!(first["status"], "missing_effect", "{}", first["summary"]);
    let effect = first["answer_set"][0].as_str().unwrap().to_owned();
    let latest = daemon.get("/api/v1/sites/demo2/diagnoses/latest");
    assert_eq!(latest.0, 200);
    assert_eq!(serde_json::from_str::<Value>(&latest.1).unwrap(), first);
    let key = keys.diagnosis("demo2");
    let asked = zenoh::ask(&session, &key, Duration::from_secs(30));
    let answer: Value = serde_json::from_str(&runtime.block_on(asked).unwrap()).unwrap();
    assert_eq!(answer, first, "the answer is what was published");

    let path = "/api/v1/sites/demo2/structure";
    let add = format!("{{\"add\": \"{effect}\", \"actor\": \"engineer\"}}");
    assert_eq!(daemon.post(path, None, &add).0, 401);
    assert_eq!(daemon.post(path, Some("not the token at all"), &add).0, 401);
    let unknown = daemon.post(path, Some(TOKEN), "{\"add\": \"magic\"}");
    assert_eq!(unknown.0, 422, "{}", unknown.1);
    let (status, body) = daemon.post(path, Some(TOKEN), &add);
    assert_eq!(status, 202, "{body}");

    let second = next();
    let structure = second["structure"].as_array().unwrap();
    assert!(
        structure.contains(&Value::from(effect.as_str())),
        "{second}"
    );
    let error = |diagnosis: &Value| diagnosis["error_to_noise"].as_f64().unwrap();
    assert!(
        error(&second) < 0.7 * error(&first),
        "{} then {}",
        error(&first),
        error(&second)
    );
    let set = wait_for("a set with the effect", || {
        let (status, body) = daemon.get("/api/v1/sites/demo2/parameters");
        let set: Value = serde_json::from_str(&body).ok()?;
        let parts = set["structure"].as_array()?;
        (status == 200 && parts.contains(&Value::from(effect.as_str()))).then_some(set)
    });
    assert_eq!(set["verdict"]["status"], "pass", "{set}");
    let history: Value = serde_json::from_str(&daemon.get(path).1).unwrap();
    assert_eq!(history[0]["actor"], "http: engineer");
    assert_eq!(history[1]["origin"], "configuration");
    let line = "loadmodeld_diagnoses_total{status=\"missing_effect\"}";
    assert!(daemon.get("/metrics").1.contains(line));
    assert!(daemon.terminate().success());
}

#[test]
fn a_site_is_fitted_with_the_effects_and_the_effect_file_that_the_configuration_names() {
    let root = Path::new(env!("CARGO_MANIFEST_DIR"));
    let file = root.join("examples/effects/recovery_from_file.toml");
    let structure = "structure = [\"zip\", \"induction_motor\", \"frequency_scaled_power\"]";
    let place = Place::with(&format!(
        "{structure}\n[effects]\nfiles = [\"{}\"]\n",
        file.display()
    ));
    let daemon = place.start();
    daemon.replay(&place.site_folder());
    let set: Value = serde_json::from_str(&daemon.wait_for_set()).unwrap();
    assert_eq!(set["structure"][2], "frequency_scaled_power");

    let server = format!("http://{}", daemon.http);
    let token = place.directory.path().join("token").display().to_string();
    let structure = |arguments: &[&str]| {
        let output = Command::new(PROGRAM)
            .args(["structure", SITE, "--server", &server])
            .args(arguments)
            .output()
            .unwrap();
        let text = String::from_utf8(output.stdout).unwrap();
        (output.status.success(), text)
    };
    let (ok, history) = structure(&[]);
    assert!(ok && history.contains("configuration"), "{history}");
    let add = ["--add", "recovery_from_file"];
    assert!(!structure(&add).0, "no token");
    let (ok, told) = structure(&[&add[..], &["--token-file", &token]].concat());
    assert!(ok && told.contains("+recovery_from_file"), "{told}");
    assert!(daemon.terminate().success());
}

#[test]
fn wrong_usage_and_unusable_configurations_have_their_exit_codes() {
    let code = |arguments: &[&str]| {
        let output = Command::new(PROGRAM).args(arguments).output().unwrap();
        output.status.code()
    };
    assert_eq!(code(&["--version"]), Some(0));
    assert_eq!(code(&["no-such-command"]), Some(64));
    assert_eq!(
        code(&["replay", "/no/such/file.txt", "--site", "a/b"]),
        Some(64)
    );
    assert_eq!(code(&["run", "--config", "/no/such/file.toml"]), Some(1));
    assert_eq!(code(&["replay", "/no/such/folder"]), Some(64));
}

/// A directory with a configuration and a store.
struct Place {
    directory: TempDir,
}

impl Place {
    fn new() -> Self {
        Self::with("")
    }

    /// Without diagnoses, which only one test looks at.
    fn with(more: &str) -> Self {
        Self::configured(false, more)
    }

    fn diagnosing(more: &str) -> Self {
        Self::configured(true, more)
    }

    fn configured(diagnose: bool, more: &str) -> Self {
        let directory = tempfile::tempdir().unwrap();
        let token = directory.path().join("token");
        fs::write(&token, TOKEN).unwrap();
        let text = format!(
            "[instance]\nname = \"tested\"\n\
             [zenoh]\nprefix = \"{PREFIX}\"\nlisten = [\"tcp/127.0.0.1:0\"]\n\
             [store]\npath = \"{}\"\n\
             [http]\nlisten = \"127.0.0.1:0\"\ntoken_file = \"{}\"\n\
             [log]\nformat = \"json\"\n\
             [measurement]\nsilence_s = 1\n\
             [identification]\nsettle_s = 2\nmax_tiers = 0\n\
             [diagnosis]\nenabled = {diagnose}\nmax_refits = 4\n\
             [[site]]\nname = \"{SITE}\"\ns_base_mva = 200\nv_base_kv = 23\nnominal_hz = 60\n{more}",
            directory.path().join("store.sqlite").display(),
            token.display()
        );
        fs::write(directory.path().join("config.toml"), text).unwrap();
        Self { directory }
    }

    /// The bundled site with some of its events.
    fn site_folder(&self) -> PathBuf {
        let bundled = Path::new(env!("CARGO_MANIFEST_DIR"))
            .join("demo-data")
            .join(SITE);
        let folder = self.directory.path().join("site");
        fs::create_dir_all(&folder).unwrap();
        let text = fs::read_to_string(bundled.join("site.json")).unwrap();
        let mut site: Value = serde_json::from_str(&text).unwrap();
        let files = EVENTS.map(|number| format!("event_{number}.csv"));
        let events = site["events"].as_array_mut().unwrap();
        events.retain(|event| files.iter().any(|file| event["file"] == **file));
        assert_eq!(events.len(), EVENTS.len());
        fs::write(folder.join("site.json"), site.to_string()).unwrap();
        for file in files {
            fs::copy(bundled.join(&file), folder.join(&file)).unwrap();
        }
        folder
    }

    /// Starts a daemon and waits until it is ready.
    #[allow(
        clippy::zombie_processes,
        reason = "a daemon that does not get ready ends the test's process with it"
    )]
    fn start(&self) -> Daemon {
        let mut child = Command::new(PROGRAM)
            .args(["run", "--config"])
            .arg(self.directory.path().join("config.toml"))
            .stderr(Stdio::piped())
            .spawn()
            .unwrap();
        let lines = lines_of(child.stderr.take().unwrap());
        let mut log = Vec::new();
        loop {
            let line = lines
                .recv_timeout(LIMIT)
                .unwrap_or_else(|_| panic!("not ready: {log:#?}"));
            log.push(line);
            let entry: Value = serde_json::from_str(log.last().unwrap()).unwrap_or_default();
            if entry["message"] == "ready" {
                let endpoints: Vec<String> = entry["zenoh"]
                    .as_str()
                    .unwrap()
                    .split('"')
                    .filter(|part| part.starts_with("tcp/"))
                    .map(str::to_owned)
                    .collect();
                return Daemon {
                    // None where the daemon is a client of a router.
                    endpoint: endpoints.first().cloned().unwrap_or_default(),
                    http: entry["http"].as_str().unwrap().parse().unwrap(),
                    child,
                };
            }
        }
    }
}

/// A daemon that is ready. Dropped, it is killed.
struct Daemon {
    child: Child,
    endpoint: String,
    http: SocketAddr,
}

impl Daemon {
    async fn session(&self) -> Session {
        zenoh::open(&ZenohOptions {
            prefix: PREFIX.to_owned(),
            mode: Mode::Client,
            listen: Vec::new(),
            connect: vec![self.endpoint.clone()],
            ..ZenohOptions::default()
        })
        .await
        .unwrap()
    }

    fn replay(&self, folder: &Path) {
        self.command("replay", &[&folder.display().to_string()]);
    }

    fn command(&self, command: &str, arguments: &[&str]) {
        let output = Command::new(PROGRAM)
            .arg(command)
            .args(arguments)
            .args([
                "--speed",
                "0",
                "--prefix",
                PREFIX,
                "--endpoint",
                &self.endpoint,
            ])
            .output()
            .unwrap();
        assert!(
            output.status.success(),
            "{}",
            String::from_utf8_lossy(&output.stderr)
        );
    }

    /// Status and body of a page.
    fn get(&self, path: &str) -> (u16, String) {
        let mut stream = TcpStream::connect(self.http).unwrap();
        write!(stream, "GET {path} HTTP/1.0\r\nHost: localhost\r\n\r\n").unwrap();
        let mut answer = String::new();
        stream.read_to_string(&mut answer).unwrap();
        let (head, body) = answer.split_once("\r\n\r\n").unwrap();
        (
            head.split(' ').nth(1).unwrap().parse().unwrap(),
            body.to_owned(),
        )
    }

    /// Number of usable events, as soon as `count` have been screened.
    fn usable_events(&self, count: usize) -> usize {
        wait_for("all events screened", || {
            let events: Value = serde_json::from_str(&self.get("/api/v1/events").1).ok()?;
            let events = events.as_array()?;
            let screened = |event: &&Value| event["screening"].is_object();
            let usable = |event: &&Value| event["screening"]["usable"] == true;
            (events.iter().filter(screened).count() == count)
                .then(|| events.iter().filter(usable).count())
        })
    }

    /// Status and body of the answer to JSON.
    fn post(&self, path: &str, token: Option<&str>, body: &str) -> (u16, String) {
        let server = format!("http://{}", self.http);
        let call = Call {
            server: &server,
            path,
            token,
            body: Some(body),
        };
        match call.answer() {
            Ok(body) => (202, body),
            Err(CallError::Refused { status, reason, .. }) => (status, reason),
            Err(other) => panic!("{other}"),
        }
    }

    /// The set in force, as soon as there is one.
    fn wait_for_set(&self) -> String {
        wait_for("a set in force", || {
            let (status, body) = self.get(&format!("/api/v1/sites/{SITE}/parameters"));
            (status == 200).then_some(body)
        })
    }

    /// Disturbances cut out since the start, whether the store knew them or not.
    fn windows_closed(&self) -> usize {
        let metrics = self.get("/metrics").1;
        let lines = metrics
            .lines()
            .filter(|l| l.starts_with("loadmodeld_windows_closed_total{"));
        lines
            .map(|l| l.rsplit(' ').next().unwrap().parse::<usize>().unwrap())
            .sum()
    }

    fn terminate(mut self) -> ExitStatus {
        let id = self.child.id().to_string();
        assert!(
            Command::new("kill")
                .args(["-TERM", &id])
                .status()
                .unwrap()
                .success()
        );
        wait_for("the end", || self.child.try_wait().unwrap())
    }
}

impl Drop for Daemon {
    fn drop(&mut self) {
        // It may have ended already.
        drop(self.child.kill());
        drop(self.child.wait());
    }
}

/// Another command as a process; it ends with the test.
struct Process {
    child: Child,
    lines: Receiver<String>,
}

impl Process {
    fn start(arguments: &[&str]) -> Self {
        let mut child = Command::new(PROGRAM)
            .args(arguments)
            .stdout(Stdio::piped())
            .spawn()
            .unwrap();
        let lines = lines_of(child.stdout.take().unwrap());
        Self { child, lines }
    }
}

impl Drop for Process {
    fn drop(&mut self) {
        // It may have ended already.
        drop(self.child.kill());
        drop(self.child.wait());
    }
}

/// `examples/python/subscribe.py` as a process; it ends with the test.
struct PythonSubscriber {
    child: Child,
    lines: Receiver<String>,
}

impl PythonSubscriber {
    /// None, and said so, without a Python that has eclipse-zenoh.
    fn start(endpoint: &str) -> Option<Self> {
        let Some(python) = std::env::var_os("LOADMODELD_TEST_PYTHON") else {
            println!("SKIPPED: the Python subscriber (LOADMODELD_TEST_PYTHON is not set)");
            return None;
        };
        let script = Path::new(env!("CARGO_MANIFEST_DIR")).join("examples/python/subscribe.py");
        let mut child = Command::new(python)
            .arg(script)
            .args([endpoint, SITE])
            .stdout(Stdio::piped())
            .spawn()
            .unwrap();
        let lines = lines_of(child.stdout.take().unwrap());
        Some(Self { child, lines })
    }
}

impl Drop for PythonSubscriber {
    fn drop(&mut self) {
        // It may have ended already.
        drop(self.child.kill());
        drop(self.child.wait());
    }
}

/// Lines of a stream, read on a thread of their own so that the writer never waits.
fn lines_of(stream: impl Read + Send + 'static) -> Receiver<String> {
    let (sender, receiver) = channel();
    thread::spawn(move || {
        for line in BufReader::new(stream).lines().map_while(Result::ok) {
            // Nobody reads any more once the daemon is ready.
            drop(sender.send(line));
        }
    });
    receiver
}

/// Asks until there is an answer.
fn wait_for<T>(what: &str, mut answer: impl FnMut() -> Option<T>) -> T {
    let begun = clock::instant();
    loop {
        if let Some(answer) = answer() {
            return answer;
        }
        assert!(begun.elapsed() < LIMIT, "waited in vain for {what}");
        thread::sleep(Duration::from_millis(50));
    }
}

fn runtime() -> Runtime {
    tokio::runtime::Builder::new_multi_thread()
        .worker_threads(2)
        .enable_all()
        .build()
        .unwrap()
}

/// A second of samples, all of one value.
fn batch(value: impl Fn(usize) -> f64) -> Vec<u8> {
    let count = 60;
    let values: Vec<f64> = (0..count).map(value).collect();
    let batch = SampleBatch {
        site: SITE.to_owned(),
        stream: "pmu".to_owned(),
        sequence: None,
        start_ns: 1_767_225_600_000_000_000,
        rate_fps: 60.0,
        channels: [
            Channel::VoltagePu,
            Channel::FrequencyHz,
            Channel::ActivePu,
            Channel::ReactivePu,
        ]
        .map(|channel| (channel, values.clone()))
        .to_vec(),
        quality: vec![Quality::GOOD; count],
    };
    encode_batch_json(&batch, 60.0).unwrap()
}

/// How many events a diagnosis was made from.
fn events_of(diagnosis: &Value) -> usize {
    let lists = ["fit", "gate", "untouched", "refused"];
    let length = |list: &str| diagnosis["events"][list].as_array().unwrap().len();
    lists.into_iter().map(length).sum()
}

/// The folder of a bundled site.
fn bundled(site: &str) -> PathBuf {
    let root = Path::new(env!("CARGO_MANIFEST_DIR"));
    root.join("demo-data").join(site)
}

/// The table of a bundled site.
fn site_table(site: &str) -> String {
    let text = fs::read_to_string(bundled(site).join("site.json")).unwrap();
    let document: Value = serde_json::from_str(&text).unwrap();
    format!(
        "[[site]]\nname = \"{site}\"\ns_base_mva = {}\nv_base_kv = {}\nnominal_hz = {}\n",
        document["base_mva"], document["base_kv"], document["nominal_hz"]
    )
}

/// The tables of a site whose recorder has these voltage and current channels.
fn recorder(site: &str, base_mva: u32, voltage: &str, current: &str) -> String {
    let three = |kind: &str, rest: &str| {
        ["a", "b", "c"]
            .map(|phase| format!("\"{kind}{phase}_{rest}\""))
            .join(", ")
    };
    format!(
        "[[site]]\nname = \"{site}\"\ns_base_mva = {base_mva}\nv_base_kv = 110\nnominal_hz = 50\n\
         [[site.recording]]\nvoltages = [{}]\ncurrents = [{}]\n",
        three("U", voltage),
        three("I", current)
    )
}
