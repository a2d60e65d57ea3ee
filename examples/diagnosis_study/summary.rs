//! The tables of `docs/diagnosis-rates.md` from the lines of a study.

use std::collections::BTreeMap;

use serde_json::Value;

use super::cases::same;

/// Error over noise above which a structure visibly fails.
const SHOWS: f64 = 1.5;

/// One line, judged.
struct Judged<'a> {
    line: &'a Value,
    truth: Vec<&'a str>,
    /// Answers of the rounds, without a stator resistance that is truly there and was named first.
    answers: Vec<Vec<&'a str>>,
    /// Error over noise that the hidden effects leave: with the resistance in the model where the
    /// site has one.
    left: f64,
    resistance_first: bool,
}

fn strings(value: &Value) -> Vec<&str> {
    let array = value.as_array().unwrap().iter();
    array.map(|word| word.as_str().unwrap()).collect()
}

fn numbers(value: &Value) -> Vec<f64> {
    let array = value.as_array().unwrap().iter();
    array
        .map(|number| number.as_f64().unwrap_or(f64::NAN))
        .collect()
}

impl<'a> Judged<'a> {
    fn new(line: &'a Value) -> Self {
        let truth = strings(&line["truth"]);
        let mut answers: Vec<Vec<&str>> = line["answers"]
            .as_array()
            .unwrap()
            .iter()
            .map(strings)
            .collect();
        let with_resistance = line["with_resistance"].as_f64();
        let named_first = answers[0].first() == Some(&"stator_resistance");
        let resistance_first =
            with_resistance.is_some() && named_first && !truth.contains(&"stator_resistance");
        if resistance_first {
            answers.remove(0);
        }
        let plain = numbers(&line["fitted"])[0];
        Self {
            line,
            left: with_resistance
                .filter(|_| !truth.contains(&"stator_resistance"))
                .unwrap_or(plain),
            truth,
            answers,
            resistance_first,
        }
    }

    fn first(&self) -> Option<&'a str> {
        self.answers.first().and_then(|set| set.first()).copied()
    }

    fn right(&self) -> bool {
        self.first().is_some_and(|named| same(self.truth[0], named))
    }

    fn in_set(&self) -> bool {
        self.set().iter().any(|named| same(self.truth[0], named))
    }

    fn set(&self) -> &[&'a str] {
        self.answers.first().map_or(&[], Vec::as_slice)
    }

    fn shows(&self) -> bool {
        self.left > SHOWS
    }

    fn status(&self) -> &'a str {
        let rounds = usize::from(self.resistance_first);
        let last = self.line["answers"].as_array().unwrap().len() == rounds + 1;
        let status = if last { "last_status" } else { "status" };
        self.line[status].as_str().unwrap()
    }

    fn named(&self) -> String {
        self.first()
            .map_or_else(|| self.status().to_owned(), str::to_owned)
    }

    fn quoted(&self) -> Vec<f64> {
        numbers(&self.line["quoted"])
    }

    fn number(&self, key: &str) -> f64 {
        self.line[key].as_f64().unwrap()
    }
}

fn percent(part: usize, whole: usize) -> String {
    if whole == 0 {
        return "-".to_owned();
    }
    format!(
        "{part} of {whole} ({:.0} %)",
        100.0 * part as f64 / whole as f64
    )
}

fn count<'a>(judged: &[&Judged<'a>], holds: impl Fn(&Judged<'a>) -> bool) -> usize {
    judged.iter().filter(|j| holds(j)).count()
}

pub(crate) fn print(lines: &[Value]) {
    let judged: Vec<Judged<'_>> = lines.iter().map(Judged::new).collect();
    let of = |kind: &str| -> Vec<&Judged<'_>> {
        judged.iter().filter(|j| j.line["kind"] == kind).collect()
    };
    singles(&of("single"));
    nothing(&of("nothing"));
    pairs(&of("pair"));
    outside("Outside the catalogue", &of("outside"));
    outside("Loads of no catalogue", &of("novel"));
    let mut seconds: Vec<f64> = judged.iter().map(|j| j.number("seconds")).collect();
    seconds.sort_by(f64::total_cmp);
    if let (Some(middle), Some(late)) = (
        seconds.get(seconds.len() / 2),
        seconds.get(seconds.len() * 9 / 10),
    ) {
        println!(
            "\nA site with all its rounds: {middle:.0} s by the clock in the median, {late:.0} s at 90 %."
        );
    }
}

fn singles(judged: &[&Judged<'_>]) {
    let mut by_truth: BTreeMap<&str, Vec<&Judged<'_>>> = BTreeMap::new();
    for site in judged {
        by_truth.entry(site.truth[0]).or_default().push(site);
    }
    println!(
        "| hidden | sites | shows | right first | in the set | right although it hardly shows | answers where it shows |"
    );
    println!("|---|---|---|---|---|---|---|");
    for (truth, sites) in &by_truth {
        let shown: Vec<&Judged<'_>> = sites.iter().copied().filter(|s| s.shows()).collect();
        let hardly: Vec<&Judged<'_>> = sites.iter().copied().filter(|s| !s.shows()).collect();
        println!(
            "| {truth} | {} | {} | {} | {} | {} of {} | {} |",
            sites.len(),
            shown.len(),
            count(&shown, Judged::right),
            count(&shown, Judged::in_set),
            count(&hardly, Judged::right),
            hardly.len(),
            tally(shown.iter().map(|s| s.named()))
        );
    }
    let shown: Vec<&Judged<'_>> = judged.iter().copied().filter(|s| s.shows()).collect();
    let hardly: Vec<&Judged<'_>> = judged.iter().copied().filter(|s| !s.shows()).collect();
    let named = shown.iter().filter(|s| !s.set().is_empty());
    let sizes: Vec<usize> = named.map(|s| s.set().len()).collect();
    let wrongly = count(&hardly, |s| s.first().is_some() && !s.right());
    println!(
        "\nWhere it shows: right first {}, in the answer set {}, mean size of the set {:.2}.",
        percent(count(&shown, Judged::right), shown.len()),
        percent(count(&shown, Judged::in_set), shown.len()),
        sizes.iter().sum::<usize>() as f64 / sizes.len().max(1) as f64
    );
    println!(
        "Where it hardly shows: right {}, another effect {}.",
        percent(count(&hardly, Judged::right), hardly.len()),
        percent(wrongly, hardly.len())
    );
    after(&shown);
    println!("\nWrong where it shows:\n");
    for site in shown.iter().filter(|s| !s.right()) {
        println!(
            "- {} (leaves {:.1}): {}",
            site.line["case"].as_str().unwrap(),
            site.left,
            or_named(site)
        );
    }
    println!("\nWrong where it hardly shows:\n");
    for site in hardly.iter().filter(|s| s.first().is_some() && !s.right()) {
        println!(
            "- {} (leaves {:.1}): {}",
            site.line["case"].as_str().unwrap(),
            site.left,
            or_named(site)
        );
    }
    conditions(&shown);
}

/// Rates by what a site is like.
fn conditions(shown: &[&Judged<'_>]) {
    println!("\n| where it shows | right first | in the set |\n|---|---|---|");
    let groups: [(&str, &str, &[f64]); 4] = [
        ("noise", "noise", &[0.000_5, 0.001, 0.002]),
        ("frames/s", "rate_fps", &[30.0, 50.0, 60.0, 120.0]),
        ("usable events up to", "events", &[6.0, 8.0, 10.0, 12.0]),
        (
            "lowest voltage up to",
            "lowest_voltage",
            &[0.5, 0.7, 0.8, 1.0],
        ),
    ];
    for (what, key, limits) in groups {
        rates(what, shown, limits, |s| s.number(key));
    }
    rates(
        "leaves up to, times the noise",
        shown,
        &[2.0, 3.0, 10.0, f64::INFINITY],
        |s| s.left,
    );
}

fn or_named(site: &Judged<'_>) -> String {
    if site.set().is_empty() {
        site.named()
    } else {
        site.set().join(", ")
    }
}

fn rates(what: &str, shown: &[&Judged<'_>], limits: &[f64], of: impl Fn(&Judged<'_>) -> f64) {
    let mut above = f64::NEG_INFINITY;
    for &limit in limits {
        let within: Vec<&Judged<'_>> = shown
            .iter()
            .copied()
            .filter(|s| of(s) > above && of(s) <= limit)
            .collect();
        println!(
            "| {what} {limit} | {} | {} |",
            percent(count(&within, Judged::right), within.len()),
            percent(count(&within, Judged::in_set), within.len())
        );
        above = limit;
    }
}

fn after(shown: &[&Judged<'_>]) {
    let right: Vec<&Judged<'_>> = shown.iter().copied().filter(|s| s.right()).collect();
    let last = |s: &Judged<'_>| *s.quoted().last().unwrap();
    println!(
        "After the last round the error on events that nothing was fitted to or chosen by is within 1.5 times the floor at {}, of those named rightly {}; above where it began at {}.",
        percent(
            count(shown, |s| last(s) <= 1.5 * s.number("noise_floor")),
            shown.len()
        ),
        percent(
            count(&right, |s| last(s) <= 1.5 * s.number("noise_floor")),
            right.len()
        ),
        percent(
            count(shown, |s| last(s) > 1.05 * s.quoted()[0]),
            shown.len()
        )
    );
}

fn nothing(judged: &[&Judged<'_>]) {
    let claims = count(judged, |s| s.first().is_some());
    let unknown = count(judged, |s| s.status() == "unknown_effect");
    println!(
        "\nNothing hidden: an effect named at {}, an unknown one at {}.",
        percent(claims, judged.len()),
        percent(unknown, judged.len())
    );
    for site in judged.iter().filter(|s| s.first().is_some()) {
        println!(
            "- {}: {}",
            site.line["case"].as_str().unwrap(),
            or_named(site)
        );
    }
}

fn pairs(judged: &[&Judged<'_>]) {
    let found = |site: &Judged<'_>| {
        let added = strings(&site.line["added"]);
        let steps: Vec<&str> = added
            .into_iter()
            .filter(|a| *a != "stator_resistance")
            .take(3)
            .collect();
        site.truth
            .iter()
            .filter(|t| steps.iter().any(|s| same(t, s)))
            .count()
    };
    println!(
        "\nPairs: both found within three steps {}, at least one {}.",
        percent(count(judged, |s| found(s) == 2), judged.len()),
        percent(count(judged, |s| found(s) >= 1), judged.len())
    );
    for site in judged.iter().filter(|s| found(s) < 2) {
        println!(
            "- {} (leaves {:.1}): {}, then {}; error {:.1} to {:.1}",
            site.line["case"].as_str().unwrap(),
            site.left,
            strings(&site.line["added"]).join(", "),
            site.line["last_status"].as_str().unwrap(),
            site.quoted()[0],
            site.quoted().last().unwrap()
        );
    }
}

fn outside(what: &str, judged: &[&Judged<'_>]) {
    let shown: Vec<&Judged<'_>> = judged.iter().copied().filter(|s| s.shows()).collect();
    println!(
        "\n{what}: said to be unknown {} of those that show.",
        percent(
            count(&shown, |s| s.status() == "unknown_effect"),
            shown.len()
        )
    );
    for site in shown.iter().filter(|s| s.status() != "unknown_effect") {
        println!(
            "- {} (leaves {:.1}): {}; error {:.1} to {:.1}",
            site.line["case"].as_str().unwrap(),
            site.left,
            or_named(site),
            site.quoted()[0],
            site.quoted().last().unwrap()
        );
    }
}

fn tally(named: impl Iterator<Item = String>) -> String {
    let mut counts: BTreeMap<String, u32> = BTreeMap::new();
    for name in named {
        *counts.entry(name).or_default() += 1;
    }
    let words: Vec<String> = counts
        .iter()
        .map(|(name, count)| format!("{name} {count}"))
        .collect();
    words.join(", ")
}
