//! How the C37.118 frames of a site's streams are read.

use std::collections::BTreeSet;

use toml::de::{DeArray, DeValue};

use super::{
    SiteConfig, StreamConfig,
    section::{Findings, Section},
    site::chunk,
};
use crate::{
    adapters::c37118::{AnalogPower, FloatFrequency, PhasorSet, PmuChoice, PowerSource, SignedSet},
    measurement::phasor::Connection,
};

const SET: &str =
    "one phasor [\"V1\"] (positive sequence) or three [\"a\", \"b\", \"c\"], by name or \"#n\"";
const FEEDERS: &str =
    "one phasor [\"I1\"] or three [\"a\", \"b\", \"c\"], or an array of such for several feeders";

/// Reads every `[[site.c37118]]` of a site.
pub(super) fn streams(section: &mut Section<'_>, site: &mut SiteConfig) -> Findings {
    let mut findings = Findings::default();
    let mut seen = BTreeSet::new();
    for mut section in section.sections("c37118") {
        let to = stream(&mut section);
        if !seen.insert(to.stream.clone()) {
            section.object(
                "stream",
                "another table of this site has this stream already",
                "a name of its own",
            );
        }
        findings.add(section.finish());
        site.streams.push(to);
    }
    findings
}

fn stream(section: &mut Section<'_>) -> StreamConfig {
    const CONNECTIONS: [(&str, Connection); 2] = [
        ("line_to_ground", Connection::LineToGround),
        ("line_to_line", Connection::LineToLine),
    ];
    const FREQUENCIES: [(&str, FloatFrequency); 3] = [
        ("hertz", FloatFrequency::Hertz),
        ("deviation_hertz", FloatFrequency::DeviationHertz),
        ("deviation_millihertz", FloatFrequency::DeviationMillihertz),
    ];
    const RATIO: (f64, f64) = (1e-6, 1e6);
    let mut to = StreamConfig::default();
    section.text("stream", &mut to.stream, |text| match text {
        "*" => Ok(text.to_owned()),
        _ => chunk(text).map_err(|allowed| format!("\"*\" for any, or {allowed}")),
    });
    let mapping = &mut to.mapping;
    mapping.pmu = pmu(section);
    section.require("voltage", SET);
    if let Some(array) = section.array("voltage") {
        match set(array) {
            Some(voltage) => mapping.voltage = voltage,
            None => section.object("voltage", "not one or three phasors", SET),
        }
    }
    mapping.power = power(section);
    section.choice("connection", &mut mapping.connection, &CONNECTIONS);
    section.number("voltage_ratio", &mut mapping.voltage_ratio, RATIO);
    section.number("current_ratio", &mut mapping.current_ratio, RATIO);
    let frequency = &mut mapping.float_frequency;
    section.choice("float_frequency", frequency, &FREQUENCIES);
    to
}

fn pmu(section: &mut Section<'_>) -> PmuChoice {
    let (mut id_code, mut station) = (0_u16, String::new());
    section.count("pmu", &mut id_code, (0, 65_534));
    section.text("station", &mut station, |text| Ok(text.trim().to_owned()));
    match (id_code, station.is_empty()) {
        (0, true) => PmuChoice::Only,
        (0, false) => PmuChoice::Station(station),
        (id_code, true) => PmuChoice::IdCode(id_code),
        (id_code, false) => {
            section.object(
                "station",
                "the PMU is named twice",
                "either pmu or station, the other 0 or \"\"",
            );
            PmuChoice::IdCode(id_code)
        }
    }
}

/// From currents, or from two analog values.
fn power(section: &mut Section<'_>) -> PowerSource {
    const MEGA: (f64, f64) = (-1e6, 1e6);
    let analog = |text: &str| Ok(text.trim().to_owned());
    let (mut active, mut reactive, mut mega_per_unit) = (String::new(), String::new(), 1.0);
    section.text("active", &mut active, analog);
    section.text("reactive", &mut reactive, analog);
    section.number("mega_per_unit", &mut mega_per_unit, MEGA);
    let currents = currents(section);
    match (active.is_empty(), reactive.is_empty()) {
        (true, true) => {
            if currents.is_empty() {
                section.object("currents", "the power is measured by nothing", FEEDERS);
            }
            PowerSource::Currents(currents)
        }
        (false, false) => {
            if !currents.is_empty() {
                section.object(
                    "currents",
                    "the power is measured twice",
                    "either currents, or active and reactive",
                );
            }
            let power = |channel| AnalogPower {
                channel,
                mega_per_unit,
            };
            PowerSource::Analogs {
                active: power(active),
                reactive: power(reactive),
            }
        }
        _ => {
            let key = if active.is_empty() {
                "active"
            } else {
                "reactive"
            };
            section.object(
                key,
                "only one of two powers is named",
                "active and reactive",
            );
            PowerSource::Currents(currents)
        }
    }
}

/// The feeders with their signs; none when the key is not there.
fn currents(section: &mut Section<'_>) -> Vec<SignedSet> {
    let mut sets = Vec::new();
    if let Some(array) = section.array("currents") {
        match feeders(array) {
            Some(found) => sets = found,
            None => section.object("currents", "not one or three phasors per feeder", FEEDERS),
        }
    }
    let mut signs = vec![1; sets.len()];
    if let Some(array) = section.array("current_signs")
        && !array.is_empty()
    {
        let found = array.iter().map(|sign| match sign.get_ref() {
            DeValue::Integer(sign) => match sign.as_str() {
                "1" | "+1" => Some(1),
                "-1" => Some(-1),
                _ => None,
            },
            _ => None,
        });
        match found.collect::<Option<Vec<_>>>() {
            Some(found) if found.len() == sets.len() => signs = found,
            _ => section.object(
                "current_signs",
                "not one sign per feeder",
                "1 (into the load) or -1 for each feeder, or [] for all into the load",
            ),
        }
    }
    let signed = |(phasors, sign): (PhasorSet, i32)| SignedSet {
        phasors,
        reversed: sign < 0,
    };
    sets.into_iter().zip(signs).map(signed).collect()
}

/// One feeder, or an array of feeders. An empty array is no feeder.
fn feeders(array: &DeArray<'_>) -> Option<Vec<PhasorSet>> {
    if array.is_empty() {
        return Some(Vec::new());
    }
    if let Some(one) = set(array) {
        return Some(vec![one]);
    }
    let sets = array.iter().map(|feeder| set(feeder.get_ref().as_array()?));
    sets.collect()
}

/// One name, or three.
fn set(array: &DeArray<'_>) -> Option<PhasorSet> {
    let name = |value: &toml::Spanned<DeValue<'_>>| {
        let name = value.get_ref().as_str()?.trim();
        (!name.is_empty()).then(|| name.to_owned())
    };
    let names: Vec<String> = array.iter().map(name).collect::<Option<_>>()?;
    match <[String; 1]>::try_from(names) {
        Ok([name]) => Some(PhasorSet::PositiveSequence(name)),
        Err(names) => names.try_into().ok().map(PhasorSet::Phases),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{adapters::c37118::LoadMapping, config::Config};

    const SITE: &str = "[[site]]\nname = \"n\"\ns_base_mva = 1\nv_base_kv = 1\nnominal_hz = 50\n\
                        [[site.c37118]]\n";

    fn mapping(text: &str) -> LoadMapping {
        let config = Config::parse(&format!("{SITE}{text}"), "test").unwrap();
        config.sites[0].streams[0].mapping.clone()
    }

    fn problems(text: &str) -> String {
        Config::parse(&format!("{SITE}{text}"), "test")
            .unwrap_err()
            .to_string()
    }

    #[test]
    fn several_feeders_have_signs_of_their_own() {
        let mapping = mapping(
            "pmu = 7\nvoltage = [\"V1\"]\ncurrents = [[\"I1\"], [\"a\", \"b\", \"#3\"]]\n\
             current_signs = [1, -1]\nfloat_frequency = \"deviation_hertz\"\n",
        );
        assert_eq!(mapping.pmu, PmuChoice::IdCode(7));
        let PowerSource::Currents(sets) = mapping.power else {
            panic!("{:?}", mapping.power);
        };
        assert_eq!(
            sets[0].phasors,
            PhasorSet::PositiveSequence("I1".to_owned())
        );
        assert!(!sets[0].reversed && sets[1].reversed);
        assert_eq!(mapping.float_frequency, FloatFrequency::DeviationHertz);
    }

    #[test]
    fn power_from_analog_values_needs_no_currents() {
        let mapping = mapping(
            "voltage = [\"a\", \"b\", \"c\"]\nactive = \"P\"\nreactive = \"Q\"\nmega_per_unit = 0.1\n",
        );
        assert!(matches!(mapping.power, PowerSource::Analogs { .. }));
    }

    #[test]
    fn what_cannot_be_meant_is_told_with_its_key() {
        for (text, part) in [
            ("currents = [\"I1\"]\n", "site.c37118.voltage: missing"),
            (
                "voltage = [\"V1\"]\n",
                "site.c37118.currents: the power is measured by nothing",
            ),
            (
                "voltage = [\"a\", \"b\"]\ncurrents = [\"I1\"]\n",
                "site.c37118.voltage: not one or three phasors",
            ),
            (
                "voltage = [\"V1\"]\ncurrents = [\"I1\"]\nactive = \"P\"\n",
                "site.c37118.reactive: only one of two powers",
            ),
            (
                "voltage = [\"V1\"]\ncurrents = [\"I1\"]\ncurrent_signs = [1, 1]\n",
                "site.c37118.current_signs: not one sign per feeder",
            ),
            (
                "pmu = 3\nstation = \"x\"\nvoltage = [\"V1\"]\ncurrents = [\"I1\"]\n",
                "site.c37118.station: the PMU is named twice",
            ),
            (
                "voltage = [\"V1\"]\ncurrents = [\"I1\"]\n[[site.c37118]]\nvoltage = [\"V1\"]\n\
                 currents = [\"I1\"]\n",
                "site.c37118.stream: another table",
            ),
        ] {
            let found = problems(text);
            assert!(found.contains(part), "{part}: {found}");
        }
    }
}
