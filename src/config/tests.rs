//! The default file, and what is told of bad ones.

use super::*;
use crate::{
    adapters::c37118::{LoadMapping, PhasorSet},
    disturbance::DetectorOptions,
};

/// A key is commented out where no space follows the `#`.
fn with_example_site() -> String {
    let uncommented = |line: &str| {
        let rest = line.strip_prefix('#').filter(|rest| !rest.starts_with(' '));
        rest.unwrap_or(line).to_owned()
    };
    let lines: Vec<String> = DEFAULT_FILE.lines().map(uncommented).collect();
    lines.join("\n")
}

fn problems(text: &str) -> Vec<String> {
    let problems = Config::parse(text, "bad.toml").unwrap_err().to_string();
    problems.lines().map(str::to_owned).collect()
}

#[test]
fn the_default_file_says_what_is_built_in() {
    let parsed = Config::parse(DEFAULT_FILE, "loadmodeld.toml");
    assert_eq!(parsed, Ok(Config::default()));
    assert_eq!(Config::parse("", "empty.toml"), Ok(Config::default()));
}

#[test]
fn the_default_file_shows_every_key() {
    let (config, findings) = parse::config(&with_example_site());
    assert_eq!(findings.problems, []);
    // The keys of these two are shown under [detection] and [screening].
    let absent: Vec<&String> = findings
        .absent
        .iter()
        .filter(|key| !key.starts_with("site.detection.") && !key.starts_with("site.screening."))
        .collect();
    assert!(absent.is_empty(), "not shown: {absent:?}");
    assert_eq!(config.zenoh.raw.len(), 2);
}

#[test]
fn every_line_that_shows_a_key_follows_a_comment() {
    let mut commented = false;
    for line in DEFAULT_FILE.lines() {
        let is_key = line.contains(" = ") && !line.starts_with("# ");
        assert!(commented || !is_key, "no comment above: {line}");
        commented = line.starts_with('#') || is_key && commented;
    }
}

#[test]
fn the_example_site_shows_the_defaults_of_its_keys() {
    let (config, _) = parse::config(&with_example_site());
    let site = config.site("substation-1-t1").unwrap();
    assert_eq!(site.concentrator, config.measurement.concentrator);
    let expected = RecordingConfig {
        voltages: ["UA", "UB", "UC"].map(str::to_owned),
        currents: vec![["IA", "IB", "IC"].map(str::to_owned)],
        ..RecordingConfig::default()
    };
    assert_eq!(site.recordings, [expected]);
    let phases = |kind: char| PhasorSet::Phases(['A', 'B', 'C'].map(|p| format!("{kind}{p}")));
    let expected = StreamConfig {
        mapping: LoadMapping::new(phases('V'), phases('I')),
        ..StreamConfig::default()
    };
    assert_eq!(site.streams, [expected]);
    assert_eq!(site.detection.step_pu, Some(0.01));
    assert_eq!(site.screening.unbalance_refuse, None);
}

#[test]
fn a_site_overrides_what_is_set_for_all() {
    let text = r#"
        [detection]
        dip_ratio = 0.85
        step_pu = 0
        [measurement]
        lag_ms = 300
        [[site]]
        name = "a"
        s_base_mva = 10
        v_base_kv = 20
        nominal_hz = 50
        lag_ms = 50
        [site.detection]
        dip_ratio = 0.95
        [[site]]
        name = "b"
        s_base_mva = 10
        v_base_kv = 20
        nominal_hz = 60
    "#;
    let config = Config::parse(text, "sites.toml").unwrap();
    let (a, b) = (config.site("a").unwrap(), config.site("b").unwrap());
    assert_eq!(
        (a.detection.dip_ratio, b.detection.dip_ratio),
        (Some(0.95), Some(0.85))
    );
    assert_eq!((a.detection.step_pu, b.detection.step_pu), (None, None));
    assert!((a.concentrator.lag_s - 0.05).abs() < 1e-12);
    assert!((b.concentrator.lag_s - 0.3).abs() < 1e-12);
    let rest = DetectorOptions {
        dip_ratio: Some(0.95),
        step_pu: None,
        ..DetectorOptions::default()
    };
    assert_eq!(a.detection, rest);
}

#[test]
fn all_problems_are_told_at_once_with_their_places() {
    let text = "\
[detection]
dip_ratio = 1.5
dip_ration = 0.9
confirm_samples = 2.5
voltage_reference = \"nominal\"

[http]
listen = \"everywhere\"

[publishing]
manual_approval = \"yes\"

[[site]]
name = \"a b\"
s_base_mva = -1
v_base_kv = 110
id = 3

[unknown]
";
    assert_eq!(
        problems(text),
        [
            "bad.toml:2:13: detection.dip_ratio: 1.5 is not admissible; allowed: 0, or 0.1 to 0.999",
            "bad.toml:3:1: detection.dip_ration: unknown key; allowed: perhaps dip_ratio",
            "bad.toml:4:19: detection.confirm_samples: 2.5 is not admissible; allowed: a whole number, 1 to 20",
            "bad.toml:5:21: detection.voltage_reference: \"nominal\" is not admissible; allowed: \"sliding\", \"declared\"",
            "bad.toml:8:10: http.listen: \"everywhere\" is not admissible; allowed: an address and a port such as \"127.0.0.1:9464\", or \"\" for none",
            "bad.toml:11:19: publishing.manual_approval: string given; allowed: true or false",
            "bad.toml:13:1: site.nominal_hz: missing; allowed: the nominal frequency, 10 to 100 Hz",
            "bad.toml:14:8: site.name: \"a b\" is not admissible; allowed: 1 to 128 bytes, none of / * $ ? # or space, not beginning with @ or .",
            "bad.toml:15:14: site.s_base_mva: -1 is not admissible; allowed: 0.001 to 1000000",
            "bad.toml:17:1: site.id: unknown key; allowed: name, s_base_mva, v_base_kv, nominal_hz, rate_fps, expected, lag_ms, gap_restart_s, grid_tolerance_share, off_grid_restart_s, structure, detection, screening, parameter, recording, c37118",
            "bad.toml:19:2: unknown: unknown key; allowed: instance, zenoh, store, http, log, workers, measurement, detection, screening, identification, diagnosis, effects, publishing, site",
        ]
    );
}

#[test]
fn names_are_unique_and_recordings_complete() {
    let text = r#"
[[site]]
name = "a"
s_base_mva = 1
v_base_kv = 1
nominal_hz = 50
[[site.recording]]
voltages = ["a", "b"]
currents = [[1, 2, 3], [4, 5, "c"]]
[[site.recording]]
voltages = [1, 2, 3]
current_sign = 0
[[site]]
name = "a"
s_base_mva = 1
v_base_kv = 1
nominal_hz = 50
"#;
    let found = problems(text);
    let expected = [
        "site.recording.voltages: not three channels",
        "site.recording.currents: missing",
        "site.recording.recorder: another recording of this site has this recorder already",
        "site.recording.current_sign: 0 is not admissible",
        "site.name: site number 1 has this name already",
    ];
    assert_eq!(found.len(), expected.len(), "{found:#?}");
    for part in expected {
        assert!(
            found.iter().any(|line| line.contains(part)),
            "{part}: {found:#?}"
        );
    }
}

#[test]
fn keys_that_contradict_each_other_are_told() {
    let text = r#"
[zenoh]
mode = "client"
listen = ["udp/1.2.3.4:7", "tcp/localhost"]
[measurement]
lag_ms = 9000
[detection]
longest_s = 5
[identification]
structure = []
min_joint_events = 50
hold_out_share = nan
"#;
    let found = problems(text);
    for part in [
        "zenoh.mode: a client has nothing to connect to",
        "4:11: zenoh.listen: \"udp/1.2.3.4:7\" is not admissible; allowed: \"tcp/HOST:PORT\"",
        "4:28: zenoh.listen: \"tcp/localhost\" is not admissible",
        "measurement.gap_restart_s: a gap shorter than the lag time",
        "detection.longest_s: no window could end by recovery",
        "identification.structure: a model needs a part",
        "identification.max_joint_events: no site could ever be fitted jointly",
        "identification.hold_out_share: nan is not admissible",
    ] {
        assert!(
            found.iter().any(|line| line.contains(part)),
            "{part}: {found:#?}"
        );
    }
}

#[test]
fn what_is_no_toml_is_told_with_its_place() {
    let found = problems("[http\nlisten = \"\"\n[log]\nlevel = = 3\n[log]\n");
    assert!(
        found.iter().any(|line| line.starts_with("bad.toml:1:")),
        "{found:#?}"
    );
    assert!(
        found.iter().any(|line| line.starts_with("bad.toml:4:")),
        "{found:#?}"
    );
    let missing = Config::load(Path::new("does/not/exist.toml")).unwrap_err();
    assert!(
        missing
            .to_string()
            .starts_with("does/not/exist.toml: cannot be read: ")
    );
}

#[test]
fn zenohs_own_keys_are_passed_on_as_json() {
    let text = r#"
[zenoh]
mode = "client"
connect = ["tls/router.example:7447#iface=eth0"]
[zenoh.raw]
"transport/link/tls/root_ca_certificate" = "ca.pem"
access_control = { enabled = true, default_permission = "deny", rules = [] }
"#;
    let config = Config::parse(text, "raw.toml").unwrap();
    let expected = [
        (
            "access_control",
            r#"{"default_permission":"deny","enabled":true,"rules":[]}"#,
        ),
        ("transport/link/tls/root_ca_certificate", "\"ca.pem\""),
    ];
    let expected = expected.map(|(key, value)| (key.to_owned(), value.to_owned()));
    assert_eq!(config.zenoh.raw, expected);
    assert!(config.zenoh.listen.is_empty(), "a client listens nowhere");
}
