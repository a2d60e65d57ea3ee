//! The pages by HTTP: what they say, and what they refuse.

use std::time::Duration;

use serde_json::Value;

use super::{
    desk::LISTENERS_MAX,
    testing::{Server, TOKEN},
};
use crate::{
    adapters::{
        store::{JobKind, NewDecision, NewFit, NewStructure, Origin, Store, StructureChange},
        wire::v1::examples,
    },
    identification::{Decision, ParameterSet},
    telemetry::{Occurrence, intake::FramesTaken},
};

const FORM: (&str, &str) = ("Content-Type", "application/x-www-form-urlencoded");

#[tokio::test]
async fn every_page_has_its_twins_and_names_no_other_host() {
    let server = Server::start().await;
    let event = format!("/sites/site-01/events/{}", server.event);
    for path in [
        "/sites",
        "/sites/site-01/events",
        &event,
        "/sites/site-01/diagnosis",
        "/sites/site-01/structure",
        "/sites/site-01/solutions",
        "/sites/site-01/sets",
        "/streams",
        "/health",
    ] {
        let page = server.get(path).await;
        assert_eq!(page.status, 200, "{path}: {}", page.body);
        assert!(page.body.contains("<h1>"), "{path}");
        let body = page.body.replace("http://www.w3.org/", "");
        assert!(
            !body.contains("http://") && !body.contains("https://"),
            "{path}"
        );
        assert!(
            !body.contains(" style=") && !body.contains(" onclick="),
            "{path}"
        );
        let policy = page.head.to_lowercase();
        assert!(
            policy.contains("script-src 'self'; style-src 'self';"),
            "{policy}"
        );
        let json = server.get(&format!("{path}.json")).await;
        assert_eq!(json.status, 200, "{path}.json");
        assert!(
            serde_json::from_str::<Value>(&json.body)
                .unwrap()
                .is_object(),
            "{path}"
        );
        let csv = server.get(&format!("{path}.csv")).await;
        assert!(csv.head.contains("text/csv"), "{path}: {}", csv.head);
        let charts = server.get(&format!("{path}.charts.json")).await;
        assert!(
            charts.body.starts_with("{\"charts\":["),
            "{path}: {}",
            charts.body
        );
    }
}

#[tokio::test]
async fn a_stream_is_shown_with_what_is_wrong_with_it() {
    let server = Server::start().await;
    let empty = server.get("/streams").await.body;
    assert!(empty.contains("Nothing has come in yet."), "{empty}");
    FramesTaken {
        site: "site-01".to_owned(),
        stream: "<b>pmu".to_owned(),
        configured: "*".to_owned(),
        outcomes: vec![("sample", 5), ("bad_checksum", 2)],
        trouble: None,
    }
    .emit(&server.metrics);
    let page = server.get("/streams").await.body;
    assert!(page.contains("2 bad checksum"), "{page}");
    assert!(
        page.contains("&lt;b&gt;pmu"),
        "a name from the network is text"
    );
    let json: Value = serde_json::from_str(&server.get("/streams.json").await.body).unwrap();
    assert_eq!(json["streams"][0]["frames"]["bad_checksum"], 2, "{json}");
    let csv = server.get("/streams.csv").await.body;
    assert!(csv.contains("2 bad checksum"), "{csv}");
}

#[tokio::test]
async fn an_event_without_a_model_shows_its_measurement() {
    let server = Server::start().await;
    let path = format!("/sites/site-01/events/{}", server.event);
    let page = server.get(&path).await.body;
    assert!(
        page.contains("<svg") && page.contains("Voltage V, pu"),
        "{page}"
    );
    let csv = server.get(&format!("{path}.csv")).await.body;
    assert!(csv.starts_with("time_s,v_pu,freq_hz,p_pu,q_pu\n"), "{csv}");
    assert!(csv.lines().count() > 10);
}

#[tokio::test]
async fn what_does_not_exist_is_refused_with_its_name() {
    let server = Server::start().await;
    for (path, status, word) in [
        ("/nothing", 404, "/nothing"),
        ("/sites/nowhere/events", 404, "nowhere"),
        (
            "/sites/site-01/events/%22%3E%3Cscript%3E",
            404,
            "&lt;script&gt;",
        ),
        ("/sites/site-01/sets/abc", 400, "abc"),
        ("/sites/site-01/sets/7", 404, "7"),
        ("/sites/site-01/sets/99999999999999999999999", 400, "999"),
        ("/sites/site-01/diagnoses/x", 400, "x"),
        ("/sites/site-01/events?sort=sideways", 400, "sideways"),
        ("/sites/site-01/events?page=0", 400, "0"),
        ("/sites/site-01/compare?event=one", 400, "two events"),
        ("/sites/site-01/solutions?fit=set-1", 400, "set-1"),
        ("/sites/site-01/sets?from=fit-1&to=fit-2", 404, "fit-1"),
    ] {
        let answer = server.get(path).await;
        assert_eq!(answer.status, status, "{path}: {}", answer.body);
        assert!(answer.body.contains(word), "{path}: {}", answer.body);
        assert!(!answer.body.contains("\"><script>"), "{path}");
    }
    let json = server.get("/sites/nowhere/events.json").await;
    assert!(json.body.starts_with("{\"error\":"), "{}", json.body);
}

#[tokio::test]
async fn a_form_needs_the_token_the_origin_and_its_word() {
    let server = Server::start().await;
    let (origin, path) = (server.origin(), "/sites/site-01/structure");
    let own = ("Origin", origin.as_str());
    let body = "csrf=x&add=second_motor";
    let locked = server.ask("POST", path, &[FORM, own], body).await;
    assert_eq!(locked.status, 403, "{}", locked.body);
    let wrong = server
        .ask("POST", "/session", &[FORM, own], "token=wrong")
        .await;
    assert_eq!(wrong.status, 403);
    let token = format!("token={TOKEN}&next=%2Fsites%2Fsite-01%2Fstructure");
    let elsewhere = [FORM, ("Origin", "http://evil.example")];
    assert_eq!(
        server
            .ask("POST", "/session", &elsewhere, &token)
            .await
            .status,
        403
    );
    let opened = server.ask("POST", "/session", &[FORM, own], &token).await;
    assert_eq!(opened.status, 303, "{}", opened.body);
    let head = opened.head.to_lowercase();
    assert!(head.contains("httponly; samesite=strict"), "{head}");
    assert!(
        head.contains("location: /sites/site-01/structure"),
        "{head}"
    );
    let cookie = head
        .split("set-cookie: ")
        .nth(1)
        .unwrap()
        .split(';')
        .next()
        .unwrap();
    let cookie = ("Cookie", cookie);
    let page = server.ask("GET", path, &[cookie], "").await.body;
    let csrf = page.split("name=\"csrf\" value=\"").nth(1).unwrap();
    let body = format!("csrf={}&add=second_motor", csrf.split('"').next().unwrap());
    assert_eq!(
        server
            .ask(
                "POST",
                path,
                &[FORM, own, cookie],
                "csrf=x&add=second_motor"
            )
            .await
            .status,
        403
    );
    let foreign = [FORM, ("Origin", "http://evil.example"), cookie];
    assert_eq!(server.ask("POST", path, &foreign, &body).await.status, 403);
    let done = server.ask("POST", path, &[FORM, own, cookie], &body).await;
    assert_eq!(done.status, 303, "{}", done.body);
    let after = server.ask("GET", path, &[cookie], "").await.body;
    assert!(
        after.contains("ZIP + induction motor + second motor"),
        "{after}"
    );
    let unknown = body.replace("second_motor", "perpetual_motion");
    assert_eq!(
        server
            .ask("POST", path, &[FORM, own, cookie], &unknown)
            .await
            .status,
        422
    );
}

#[tokio::test]
async fn a_huge_form_is_refused() {
    let server = Server::start().await;
    // More than what sockets hold: the client sends all of it before it reads.
    let body = format!("token={}", "x".repeat(20_000_000));
    let origin = server.origin();
    let headers = [FORM, ("Origin", origin.as_str())];
    let answer = server.ask("POST", "/session", &headers, &body).await;
    assert_eq!(answer.status, 413, "{}", answer.body);
    assert!(
        answer.body.contains("larger than this form"),
        "{}",
        answer.body
    );
}

#[tokio::test]
async fn who_asks_before_sending_is_refused_without_sending() {
    let server = Server::start().await;
    let origin = server.origin();
    let headers = [
        ("Content-Type", "multipart/form-data; boundary=b"),
        ("Origin", origin.as_str()),
        ("Expect", "100-continue"),
    ];
    let path = "/sites/site-01/recordings";
    let answer = server.announce("POST", path, &headers, 20_000_000).await;
    assert_eq!(answer.status, 403, "{}", answer.head);
}

#[tokio::test]
async fn what_the_framework_refuses_is_a_page_too() {
    let server = Server::start().await;
    let origin = server.origin();
    let own = ("Origin", origin.as_str());
    for (method, path, headers, status) in [
        ("POST", "/sites/site-01/events", &[own][..], 405),
        ("POST", "/session", &[own], 415),
        ("POST", "/session", &[FORM, own], 422),
        ("GET", "/sites/%ff/events", &[], 400),
    ] {
        let answer = server.ask(method, path, headers, "a=b").await;
        assert_eq!(answer.status, status, "{method} {path}: {}", answer.body);
        assert!(
            answer.head.to_lowercase().contains("text/html"),
            "{}",
            answer.head
        );
        assert!(answer.body.contains("class=\"problem\""), "{}", answer.body);
    }
}

#[tokio::test]
async fn updates_tell_what_is_newest() {
    let server = Server::start().await;
    let answer = server.get("/sites/site-01/updates").await;
    assert_eq!(answer.status, 200);
    assert!(answer.head.contains("text/event-stream"), "{}", answer.head);
    assert!(
        answer.body.contains("event: work\ndata: []"),
        "{}",
        answer.body
    );
    assert_eq!(server.get("/sites/nowhere/updates").await.status, 404);
}

#[tokio::test]
async fn a_reader_who_has_left_a_page_holds_no_place_among_the_readers_of_updates() {
    let server = Server::start().await;
    for _ in 0..LISTENERS_MAX {
        let answer = server.get("/updates").await;
        assert!(answer.body.contains("event: change"), "{}", answer.body);
    }
    // The places are free long before the line that keeps a quiet connection open would find nobody there.
    let another = async { while server.get("/updates").await.status != 200 {} };
    let found = tokio::time::timeout(Duration::from_secs(8), another).await;
    assert!(
        found.is_ok(),
        "all places are taken by readers who have left"
    );
}

const COMMA_SEPARATED: &str = "time_s,v_pu,freq_hz,p_pu,q_pu";

/// A form with a recording of `rows` samples of one dip.
fn recording(rows: usize) -> String {
    let row = |k: usize| {
        let voltage = if k > 60 { 0.9 } else { 1.0 };
        format!("{:.4},{voltage},60,0.8,0.2\n", k as f64 / 60.0)
    };
    let file: String = (0..rows).map(row).collect();
    format!(
        "--b\r\ncontent-disposition: form-data; name=\"files\"; filename=\"dip.csv\"\r\n\r\n\
         {COMMA_SEPARATED}\n{file}\r\n--b--\r\n"
    )
}

#[tokio::test]
async fn a_program_with_the_token_sends_a_recording() {
    let server = Server::start().await;
    let path = "/api/v1/sites/site-01/recordings";
    let form = ("Content-Type", "multipart/form-data; boundary=b");
    let bearer = format!("Bearer {TOKEN}");
    let token = ("Authorization", bearer.as_str());
    let refused = server.ask("POST", path, &[form], &recording(200)).await;
    assert_eq!(refused.status, 401, "{}", refused.body);
    let foreign = [form, token, ("Origin", "http://evil.example")];
    let refused = server.ask("POST", path, &foreign, &recording(200)).await;
    assert_eq!(refused.status, 403, "{}", refused.body);
    let unfit = server
        .ask("POST", path, &[form, token], &recording(1))
        .await;
    assert_eq!(unfit.status, 400, "{}", unfit.body);
    let error: Value = serde_json::from_str(&unfit.body).unwrap();
    assert!(error["error"].is_string());
    let taken = server
        .ask("POST", path, &[form, token], &recording(200))
        .await;
    assert_eq!(taken.status, 201, "{}", taken.body);
    let said: Value = serde_json::from_str(&taken.body).unwrap();
    let comparison = server.get(said["comparison"].as_str().unwrap()).await;
    assert_eq!(comparison.status, 200, "{}", comparison.body);
    let location = taken
        .head
        .lines()
        .find_map(|line| line.strip_prefix("location: "));
    assert_eq!(server.get(location.unwrap()).await.status, 200);
}

#[tokio::test]
async fn the_interface_for_programs_refuses_in_its_own_form() {
    let server = Server::start().await;
    for (path, status) in [
        ("/api/v1/events?before_ns=yesterday", 400),
        ("/api/v1/sites/site-01/sets/first", 400),
        ("/api/v1/sites/site-01/fits?kind=other", 400),
        ("/api/v1/sites/site-01/fits/7", 404),
        ("/api/v1/sites/%ff/sets", 400),
        ("/api/v1/effects/magic", 404),
        ("/api/v1/nothing", 404),
    ] {
        let answer = server.get(path).await;
        assert_eq!(answer.status, status, "{path}: {}", answer.body);
        let said: Value = serde_json::from_str(&answer.body).expect(path);
        assert!(said["error"].is_string(), "{path}: {}", answer.body);
    }
    let all = server.get("/api/v1/effects").await;
    let all: Value = serde_json::from_str(&all.body).unwrap();
    assert!(all["effects"].as_array().unwrap().len() > 20);
    let one = server.get("/api/v1/effects/exponential_recovery").await;
    let one: Value = serde_json::from_str(&one.body).unwrap();
    assert!(one["parameters"].is_array());
}

#[tokio::test]
async fn a_list_says_how_many_there_are_though_it_reads_one_page() {
    let server = Server::start().await;
    let page = server.get("/sites/site-01/events").await.body;
    assert!(page.contains("1 of 1 events"), "{page}");
    let beyond = server.get("/sites/site-01/events?page=2").await;
    assert_eq!(beyond.status, 200);
    let refused = server.get("/sites/site-01/events?page=0").await;
    assert_eq!(refused.status, 400);
}

#[tokio::test]
async fn a_rejected_structure_is_told_from_the_one_in_force() {
    let server = Server::start().await;
    let store = server.store.as_ref();
    let fit = |inputs_hash: &str, set_of: &dyn Fn(&mut ParameterSet), decision: &Decision| {
        let mut identification = examples::identification();
        set_of(&mut identification.set);
        let new = NewFit {
            kind: JobKind::IdentifySite,
            site: "site-01",
            subject: "site-01",
            inputs_hash,
            identification: &identification,
        };
        let (fit, _) = store.save_fit(&new, 10).unwrap();
        let new = NewDecision {
            fit,
            decision,
            in_force: None,
            actor: "instance",
        };
        store.commit_decision(&new, 11).unwrap().version
    };
    let reason = "first validated set of the site".to_owned();
    let first = fit("a", &|_| {}, &Decision::Publish { reason });
    store.mark_published("site-01", first.unwrap(), 12).unwrap();
    let more = StructureChange::Add("saturation".to_owned());
    let change = NewStructure {
        site: "site-01",
        change: &more,
        origin: Origin::Http,
        actor: "engineer",
        comment: "",
    };
    store.change_structure(&change, 13).unwrap();
    let reason = "worse: held-out error-to-noise 2 against 1".to_owned();
    let with_more = |set: &mut ParameterSet| {
        set.structure.push("saturation".to_owned());
        set.structure_versions.push(1);
    };
    fit("b", &with_more, &Decision::Reject { reason });
    let page = server.get("/sites/site-01/structure").await;
    for words in [
        "The model in force is",
        "(version 1)",
        "Asked for is",
        "worse: held-out",
        "rejected",
    ] {
        assert!(page.body.contains(words), "{words}: {}", page.body);
    }
    let twin = server.get("/sites/site-01/structure.json").await;
    let twin: Value = serde_json::from_str(&twin.body).unwrap();
    assert_eq!(twin["steps"][1]["decision"], "rejected");
    assert_eq!(twin["steps"][0]["version"], 1);
    assert_eq!(twin["in_force"]["version"], 1);
}
