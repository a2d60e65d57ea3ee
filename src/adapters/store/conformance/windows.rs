//! Checks of sites, windows, screenings.

use super::{Check, save_usable, window_at, window_id};
use crate::{
    adapters::{
        store::{Saved, Store, StoreError, WindowQuery},
        wire::v1::{encode_waveforms, examples},
    },
    disturbance::Screening,
    measurement::{Progress, Site},
};

pub(super) const CHECKS: &[Check] = &[
    ("a site is kept and updated", site_is_updated),
    ("a window comes back bit by bit", window_comes_back),
    ("a known window is left as it was", known_window_is_left),
    ("a window of an unknown site is refused", unknown_site),
    ("screening is kept and replaced", screening_is_replaced),
    ("usable windows come oldest first", usable_windows_in_order),
    ("lists can be paged and filtered", lists_are_paged),
    ("windows are counted by site", windows_are_counted),
    ("a summary is announced once", announced_once),
    ("odd names are kept as they are", odd_names),
    ("progress is kept and replaced", progress_is_replaced),
];

const ALL: WindowQuery<'_> = WindowQuery {
    site: None,
    id: None,
    unscreened: false,
    unannounced: false,
    before_ns: None,
    count_max: 100,
};

fn ids(store: &dyn Store, query: &WindowQuery<'_>) -> Vec<String> {
    let summaries = store.window_summaries(query).unwrap();
    summaries.into_iter().map(|summary| summary.id).collect()
}

fn site_is_updated(store: &dyn Store) {
    let changed = Site {
        v_base_kv: 110.0,
        ..examples::site()
    };
    store.save_site(&changed, 2).unwrap();
    assert_eq!(store.sites().unwrap(), [changed]);
}

fn window_comes_back(store: &dyn Store) {
    let mut window = window_at(0);
    window.record.samples[7].angle_rad = f64::from_bits(0x7ff8_0000_0000_0bad);
    assert_eq!(store.save_window(&window, 5).unwrap(), Saved::Stored);
    let back = store.window(&window.id).unwrap().unwrap();
    // NaN is not equal to itself: compare the bits.
    assert_eq!(
        encode_waveforms(&back.record),
        encode_waveforms(&window.record)
    );
    assert_eq!(
        (back.onset, &back.triggers, back.closing),
        (window.onset, &window.triggers, window.closing)
    );
    let summary = store.window_summaries(&ALL).unwrap().remove(0);
    assert_eq!(summary.onset_ns, window.onset_ns());
    assert_eq!(summary.lowest_voltage_pu.to_bits(), 0.75_f64.to_bits());
    assert_eq!((summary.sample_count, summary.stored_ns), (60, 5));
    assert!(summary.has_waveforms && summary.screening.is_none());
    assert!(store.window("another").unwrap().is_none());
}

fn known_window_is_left(store: &dyn Store) {
    store.save_window(&window_at(0), 5).unwrap();
    let mut other = window_at(0);
    other.record.samples.truncate(40);
    assert_eq!(store.save_window(&other, 9).unwrap(), Saved::AlreadyStored);
    let kept = store.window(&other.id).unwrap().unwrap();
    assert_eq!(kept.record.samples.len(), 60);
}

fn unknown_site(store: &dyn Store) {
    let mut window = window_at(0);
    window.site = "nowhere".to_owned();
    let error = store.save_window(&window, 5).unwrap_err();
    assert!(matches!(error, StoreError::Unknown { what: "site", .. }));
    assert_eq!(
        error.to_string(),
        "cannot save a window: there is no site `nowhere`"
    );
    assert!(ids(store, &ALL).is_empty());
}

fn progress_is_replaced(store: &dyn Store) {
    let at = |newest_ns| Progress {
        newest_ns,
        rate_fps: 50.0,
    };
    let of_site = |progress| vec![("site-01".to_owned(), progress)];
    assert!(store.progress().unwrap().is_empty());
    store.save_progress(&of_site(at(7))).unwrap();
    store.save_progress(&of_site(at(5))).unwrap();
    let unknown = [of_site(at(9)), vec![("nowhere".to_owned(), at(9))]].concat();
    let error = store.save_progress(&unknown).unwrap_err();
    assert!(matches!(error, StoreError::Unknown { what: "site", .. }));
    assert_eq!(store.progress().unwrap(), of_site(at(5)), "all or nothing");
}

fn screening_is_replaced(store: &dyn Store) {
    let id = window_id(0);
    let refused = examples::screening();
    let unknown = store.save_screening(&id, &refused, 6).unwrap_err();
    assert!(matches!(
        unknown,
        StoreError::Unknown { what: "window", .. }
    ));
    store.save_window(&window_at(0), 5).unwrap();
    let save = |screening: &Screening| store.save_screening(&id, screening, 6).unwrap();
    assert_eq!(save(&refused), Saved::Stored);
    assert_eq!(save(&refused), Saved::AlreadyStored);
    let kept = store.window_summaries(&ALL).unwrap().remove(0);
    assert_eq!(kept.screening, Some(refused));
    assert!(store.usable_windows("site-01", 9).unwrap().is_empty());
    assert_eq!(save(&Screening::default()), Saved::Stored);
    assert_eq!(store.usable_windows("site-01", 9).unwrap().len(), 1);
}

fn usable_windows_in_order(store: &dyn Store) {
    for second in [30, 10, 20, 40] {
        save_usable(store, second);
    }
    store.save_window(&window_at(50), 5).unwrap();
    let windows = store.usable_windows("site-01", 3).unwrap();
    let found: Vec<_> = windows.into_iter().map(|window| window.id).collect();
    assert_eq!(found, [20, 30, 40].map(window_id));
}

fn lists_are_paged(store: &dyn Store) {
    for second in [1, 2, 3] {
        save_usable(store, second);
    }
    store.save_window(&window_at(4), 5).unwrap();
    assert_eq!(ids(store, &ALL), [4, 3, 2, 1].map(window_id));
    let page = WindowQuery {
        before_ns: Some(window_at(3).onset_ns()),
        count_max: 1,
        ..ALL
    };
    assert_eq!(ids(store, &page), [window_id(2)]);
    let unscreened = WindowQuery {
        unscreened: true,
        ..ALL
    };
    assert_eq!(ids(store, &unscreened), [window_id(4)]);
    let elsewhere = WindowQuery {
        site: Some("nowhere"),
        ..ALL
    };
    assert!(ids(store, &elsewhere).is_empty());
}

fn windows_are_counted(store: &dyn Store) {
    assert!(store.window_tallies().unwrap().is_empty());
    save_usable(store, 1);
    store.save_window(&window_at(4), 5).unwrap();
    let tallies = store.window_tallies().unwrap();
    assert_eq!(tallies.len(), 1);
    assert_eq!((tallies[0].windows, tallies[0].usable), (2, 1));
    assert_eq!(tallies[0].newest_onset_ns, window_at(4).onset_ns());
    let one = window_id(1);
    let named = WindowQuery {
        id: Some(&one),
        ..ALL
    };
    assert_eq!(ids(store, &named), [window_id(1)]);
}

fn announced_once(store: &dyn Store) {
    let unannounced = WindowQuery {
        unannounced: true,
        ..ALL
    };
    store.save_window(&window_at(0), 5).unwrap();
    assert!(ids(store, &unannounced).is_empty(), "not screened yet");
    save_usable(store, 0);
    assert_eq!(ids(store, &unannounced), [window_id(0)]);
    let mark = || store.mark_announced(&window_id(0), 8).unwrap();
    assert_eq!((mark(), mark()), (Saved::Stored, Saved::AlreadyStored));
    assert!(ids(store, &unannounced).is_empty());
    assert!(store.mark_announced("another", 8).is_err());
}

fn odd_names(store: &dyn Store) {
    let mut window = window_at(0);
    window.id = "it's \"odd\"; DROP TABLE windows; -- \u{1f50c}".to_owned();
    store.save_window(&window, 5).unwrap();
    assert_eq!(ids(store, &ALL), [window.id]);
}
