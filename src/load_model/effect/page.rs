//! The page of an effect.

use super::{Declaration, Needs, Parameter, Prior, Role, Scale};

/// The page of an effect for manual and terminal: `description` (what its file says about it), the table
/// of its parameters with what is believed of them without data, its states, what it needs, what it cannot be
/// combined with or is taken for, and where it comes from. Markdown.
#[must_use]
pub fn page(declaration: &Declaration, description: &str) -> String {
    let d = declaration;
    let mut lines = vec![
        format!("# {}", d.name),
        String::new(),
        description.trim().to_owned(),
        String::new(),
        "| parameter | symbol | unit | lower | typical | upper | prior: centre | deviation | role |"
            .to_owned(),
        "|---|---|---|---|---|---|---|---|---|".to_owned(),
    ];
    lines.extend(d.parameters.iter().map(parameter_row));
    let states = d
        .states
        .iter()
        .map(|s| format!("`{}` ({})", s.name, s.unit));
    let excludes = (d.excludes.iter()).map(|e| format!("{}, because {}", e.other, e.reason));
    let resembles = d.resembles.iter().map(|name| (*name).to_owned());
    lines.extend([
        String::new(),
        format!("States: {}.", listed(states)),
        format!("Needs: {}.", needed(&d.needs)),
        format!("Separated from its like by: {}.", d.needs.separating_event),
        format!("Cannot be combined with: {}.", listed(excludes)),
        format!("Resembles: {}.", listed(resembles)),
        format!("Version {}. Source: {}.", d.version, d.source),
        String::new(),
    ]);
    lines.join("\n")
}

fn listed(items: impl Iterator<Item = String>) -> String {
    let items: Vec<String> = items.collect();
    if items.is_empty() {
        "none".to_owned()
    } else {
        items.join(", ")
    }
}

/// The row of a parameter in the table of a page.
#[must_use]
pub fn parameter_row(p: &Parameter) -> String {
    let role = match p.role {
        Role::OneSidedAmplitude { meaningful } => {
            let absent = p.neutral;
            format!("amplitude, absent at {absent}, worth reporting from {meaningful}")
        }
        Role::TwoSidedAmplitude { meaningful } => {
            format!("amplitude of either sign, worth reporting from {meaningful}")
        }
        Role::Shape => "shape".to_owned(),
        Role::Count => "whole number, tried one after the other".to_owned(),
        Role::Shared => "shape, shared by all effects that name it".to_owned(),
        Role::Base => "base".to_owned(),
    };
    let holds = p.reference.holds();
    let holds = holds.map_or_else(String::new, |at| format!("; {at}"));
    let [centre, deviation] = prior(p);
    format!(
        "| `{}` | {} | {} | {} | {} | {} | {centre} | {deviation} | {role}{holds} |",
        p.name, p.symbol, p.unit, p.lower, p.typical, p.upper
    )
}

/// Centre and deviation of a prior, `none` where it says nothing.
fn prior(parameter: &Parameter) -> [String; 2] {
    let Prior {
        centre,
        deviation,
        scale,
    } = parameter.prior;
    // A whole number is tried, not estimated.
    if !deviation.is_finite() || parameter.role == Role::Count {
        return ["none".to_owned(), String::new()];
    }
    let of = match scale {
        Scale::Linear => "",
        Scale::Logarithmic => " of the natural logarithm",
    };
    [centre.to_string(), format!("{deviation}{of}")]
}

fn needed(needs: &Needs) -> String {
    let mut needed = vec![
        format!("a window of {} s after the event", needs.window_s),
        format!("{} frames/s", needs.rate_fps),
    ];
    if needs.frequency {
        needed.push("a frequency or angle channel".to_owned());
    }
    let optional = [
        (needs.voltage_below, "a voltage below", "of V0"),
        (needs.voltage_above, "a voltage above", "of V0"),
        (needs.frequency_deviation, "a frequency deviation of", "pu"),
    ];
    let stated = optional.into_iter();
    needed.extend(stated.filter_map(|(value, what, of)| Some(format!("{what} {} {of}", value?))));
    needed.join(", ")
}
