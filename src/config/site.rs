//! The sites and their recorders.

use std::collections::{BTreeMap, BTreeSet};

use toml::de::DeValue;

use super::{
    Config, RecordingConfig, SiteConfig, VoltageConnection, c37118,
    parse::{concentrator, detection, screening, structure},
    section::{Findings, Section},
};
use crate::{
    load_model::ParameterRange,
    measurement::{Channel, ConcentratorOptions, Site},
};

/// Reads every `[[site]]`; what a site does not say is taken from the sections for all sites.
pub(super) fn sites(sections: Vec<Section<'_>>, config: &mut Config) -> Findings {
    let mut findings = Findings::default();
    let mut seen: BTreeMap<String, usize> = BTreeMap::new();
    for (k, mut section) in sections.into_iter().enumerate() {
        let mut site = config.for_unlisted(Site {
            name: String::new(),
            s_base_mva: 100.0,
            v_base_kv: 100.0,
            nominal_hz: 50.0,
        });
        bases(&mut section, &mut site.site);
        let name = site.site.name.clone();
        if !name.is_empty()
            && let Some(first) = seen.insert(name, k)
        {
            section.object(
                "name",
                &format!("site number {} has this name already", first + 1),
                "a name of its own",
            );
        }
        streams(&mut section, &mut site.concentrator);
        structure(&mut section, &mut site.structure);
        findings.add(detection(section.section("detection"), &mut site.detection));
        findings.add(screening(section.section("screening"), &mut site.screening));
        findings.add(parameters(&mut section, &mut site));
        findings.add(recordings(&mut section, &mut site));
        findings.add(c37118::streams(&mut section, &mut site));
        findings.add(section.finish());
        config.sites.push(site);
    }
    findings
}

/// A chunk of a key expression: the rule for names of sites, recorders and instances.
pub(super) fn chunk(text: &str) -> Result<String, String> {
    /// As on the wire.
    const BYTES_MAX: usize = 128;
    let forbidden = |c: char| "/*$?#".contains(c) || c.is_whitespace() || c.is_control();
    if text.is_empty()
        || text.len() > BYTES_MAX
        || text.starts_with(['@', '.'])
        || text.contains(forbidden)
    {
        return Err(format!(
            "1 to {BYTES_MAX} bytes, none of / * $ ? # or space, not beginning with @ or ."
        ));
    }
    Ok(text.to_owned())
}

fn bases(section: &mut Section<'_>, site: &mut Site) {
    section.text("name", &mut site.name, chunk);
    section.require("name", "the name of the site");
    section.number("s_base_mva", &mut site.s_base_mva, (1e-3, 1e6));
    section.require("s_base_mva", "the power base, 0.001 to 1000000 MVA");
    section.number("v_base_kv", &mut site.v_base_kv, (0.1, 2000.0));
    section.require("v_base_kv", "the line-to-line voltage base, 0.1 to 2000 kV");
    section.number("nominal_hz", &mut site.nominal_hz, (10.0, 100.0));
    section.require("nominal_hz", "the nominal frequency, 10 to 100 Hz");
}

fn streams(section: &mut Section<'_>, to: &mut ConcentratorOptions) {
    section.number_or_none("rate_fps", &mut to.rate_fps, ConcentratorOptions::RATE_FPS);
    section.texts("expected", &mut to.expected, |text| match text {
        "angle" => Ok(Channel::AngleRad),
        "negative_sequence" => Ok(Channel::NegativeSequenceRatio),
        _ => Err("\"angle\", \"negative_sequence\"".into()),
    });
    concentrator(section, to);
}

/// Whether the names are parameters, and the figures admissible, is looked at when all effects are known.
fn parameters(section: &mut Section<'_>, to: &mut SiteConfig) -> Findings {
    const ANY: (f64, f64) = (-1e9, 1e9);
    let mut findings = Findings::default();
    for mut section in section.sections("parameter") {
        let mut range = ParameterRange::default();
        section.text("name", &mut range.name, |name| Ok(name.trim().to_owned()));
        section.require("name", "the name of a parameter, such as \"motor_share\"");
        section.number_if_given("lower", &mut range.lower, ANY);
        section.number_if_given("upper", &mut range.upper, ANY);
        section.number_if_given("centre", &mut range.centre, ANY);
        section.number_if_given("deviation", &mut range.deviation, (1e-9, 1e9));
        let keys = ["name", "lower", "upper", "centre", "deviation"];
        let places = keys.map(|key| (key, section.place_of(key)));
        findings.add(section.finish());
        to.parameters.push(range);
        to.parameter_places.push(places.into_iter().collect());
    }
    findings
}

fn recordings(section: &mut Section<'_>, site: &mut SiteConfig) -> Findings {
    let mut findings = Findings::default();
    let mut seen = BTreeSet::new();
    for mut section in section.sections("recording") {
        let mut to = RecordingConfig::default();
        recording(&mut section, &mut to);
        if !seen.insert(to.recorder.clone()) {
            section.object(
                "recorder",
                "another recording of this site has this recorder already",
                "a name of its own",
            );
        }
        findings.add(section.finish());
        site.recordings.push(to);
    }
    findings
}

fn recording(section: &mut Section<'_>, to: &mut RecordingConfig) {
    const CONNECTIONS: [(&str, VoltageConnection); 2] = [
        ("line_to_ground", VoltageConnection::LineToGround),
        ("line_to_line", VoltageConnection::LineToLine),
    ];
    const RATIO: (f64, f64) = (1e-6, 1e6);
    section.text("recorder", &mut to.recorder, |text| match text {
        "*" => Ok(text.to_owned()),
        _ => chunk(text).map_err(|allowed| format!("\"*\" for any, or {allowed}")),
    });
    voltages(section, to);
    currents(section, to);
    section.choice("connection", &mut to.connection, &CONNECTIONS);
    section.choice_of_sign("current_sign", &mut to.currents_reversed);
    section.number_or_none("voltage_ratio", &mut to.voltage_ratio, RATIO);
    section.number_or_none("current_ratio", &mut to.current_ratio, RATIO);
    section.number("phasors_per_cycle", &mut to.phasors_per_cycle, (0.1, 100.0));
    section.flag("apply_skew", &mut to.apply_skew);
    section.count("utc_offset_s", &mut to.utc_offset_s, (-86_400, 86_400));
    section.flag("lenient", &mut to.lenient);
}

const THREE: &str = "three channels [\"a\", \"b\", \"c\"], by name or number";

fn voltages(section: &mut Section<'_>, to: &mut RecordingConfig) {
    section.require("voltages", THREE);
    if let Some(array) = section.array("voltages") {
        match three(array.iter().map(toml::Spanned::get_ref)) {
            Some(channels) => to.voltages = channels,
            None => section.object("voltages", "not three channels", THREE),
        }
    }
}

/// Three channels, or an array of threes for several feeders.
fn currents(section: &mut Section<'_>, to: &mut RecordingConfig) {
    const ALLOWED: &str =
        "three channels [\"a\", \"b\", \"c\"], or an array of such for several feeders";
    section.require("currents", ALLOWED);
    let Some(array) = section.array("currents") else {
        return;
    };
    if let Some(channels) = three(array.iter().map(toml::Spanned::get_ref)) {
        to.currents = vec![channels];
        return;
    }
    let feeders = array.iter().map(|feeder| {
        let channels = feeder.get_ref().as_array()?;
        three(channels.iter().map(toml::Spanned::get_ref))
    });
    match feeders.collect::<Option<Vec<_>>>() {
        Some(feeders) if !feeders.is_empty() => to.currents = feeders,
        _ => section.object("currents", "not three channels per feeder", ALLOWED),
    }
}

fn three<'a>(values: impl Iterator<Item = &'a DeValue<'a>>) -> Option<[String; 3]> {
    let names: Option<Vec<String>> = values.map(channel).collect();
    names?.try_into().ok()
}

fn channel(value: &DeValue<'_>) -> Option<String> {
    match value {
        DeValue::String(name) if !name.trim().is_empty() => Some(name.to_string()),
        DeValue::Integer(number) => i64::from_str_radix(number.as_str(), number.radix())
            .ok()
            .filter(|number| *number > 0)
            .map(|number| number.to_string()),
        _ => None,
    }
}
