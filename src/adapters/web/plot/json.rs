//! Charts for `static/chart.js`.

use base64::{Engine, engine::general_purpose::STANDARD as BASE64};
use serde_json::{Value, json};

use super::{Chart, Mark, Panel};

/// Numbers of a list from which on it is written as bytes: text takes several times as long to write and to read.
const PACKED_FROM: usize = 256;
/// Significant digits of a drawn number: far below a pixel at any zoom that shows something.
const DIGITS: i32 = 7;

/// The document of charts.
pub(in super::super) fn charts_json(charts: &[Chart]) -> Value {
    json!({ "charts": charts.iter().map(chart).collect::<Vec<_>>() })
}

fn chart(chart: &Chart) -> Value {
    json!({
        "id": chart.id,
        "title": chart.title,
        "horizontal": pair(chart.horizontal),
        "horizontal_title": chart.horizontal_title,
        "names": chart.names,
        "linked": chart.linked,
        "x": numbers(&chart.x),
        "panels": chart.panels.iter().map(panel).collect::<Vec<_>>(),
    })
}

fn panel(panel: &Panel) -> Value {
    json!({
        "title": panel.title,
        "height": panel.height,
        "vertical": pair(panel.vertical),
        "logarithmic": panel.logarithmic,
        "marks": panel.marks.iter().map(mark).collect::<Vec<_>>(),
    })
}

fn mark(mark: &Mark) -> Value {
    match mark {
        Mark::Line {
            name,
            ink,
            x,
            y,
            dashed,
        } => json!({
            "kind": "line", "name": name, "ink": ink.name(), "x": own(x.as_ref()), "y": numbers(y),
            "dashed": dashed,
        }),
        Mark::Points {
            name,
            ink,
            shape,
            x,
            y,
            shade,
        } => json!({
            "kind": "points", "name": name, "ink": ink.name(), "shape": shape.name(),
            "x": own(x.as_ref()), "y": numbers(y), "shade": own(shade.as_ref()),
        }),
        Mark::Band {
            name,
            ink,
            x,
            low,
            high,
        } => json!({
            "kind": "band", "name": name, "ink": ink.name(), "x": own(x.as_ref()),
            "low": numbers(low), "high": numbers(high),
        }),
        Mark::Bars {
            name,
            ink,
            x,
            y,
            base,
            half_width,
        } => json!({
            "kind": "bars", "name": name, "ink": ink.name(), "x": numbers(x), "y": numbers(y),
            "base": number(*base), "half_width": number(*half_width),
        }),
        Mark::Strip {
            name,
            from,
            to,
            ink,
        } => json!({
            "kind": "strip", "name": name, "ink": ink.name(), "from": number(*from), "to": number(*to),
        }),
        Mark::Upright { at } => json!({ "kind": "upright", "at": number(*at) }),
        Mark::Level { name, ink, at } => json!({
            "kind": "level", "name": name, "ink": ink.name(), "at": number(*at),
        }),
        Mark::Label { x, y, text } => json!({
            "kind": "label", "x": number(*x), "y": number(*y), "text": text,
        }),
    }
}

fn own(values: Option<&Vec<f64>>) -> Value {
    values.map_or(Value::Null, |values| numbers(values))
}

fn pair((low, high): (f64, f64)) -> Value {
    json!([low, high])
}

fn numbers(values: &[f64]) -> Value {
    if values.len() >= PACKED_FROM {
        return json!({ "f32": packed(values) });
    }
    Value::Array(values.iter().map(|value| number(*value)).collect())
}

/// Base64 of 32-bit floats, lowest byte first: seven digits, and no number where there is a gap.
#[allow(
    clippy::cast_possible_truncation,
    reason = "seven digits are far below a pixel at any zoom that shows something"
)]
fn packed(values: &[f64]) -> String {
    let bytes: Vec<u8> = values
        .iter()
        .map(|value| if value.is_finite() { *value } else { f64::NAN })
        .flat_map(|value| (value as f32).to_le_bytes())
        .collect();
    BASE64.encode(bytes)
}

/// A number that is not finite is null.
fn number(value: f64) -> Value {
    if value == 0.0 || !value.is_finite() {
        return json!(value);
    }
    #[allow(
        clippy::cast_possible_truncation,
        reason = "the logarithm of a finite number lies within -324 and 308"
    )]
    let magnitude = value.abs().log10().floor() as i32;
    let decimals = DIGITS - 1 - magnitude;
    if !(0..=12).contains(&decimals) {
        return json!(value);
    }
    let scale = 10_f64.powi(decimals);
    json!((value * scale).round() / scale)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_gap_is_null_and_digits_are_those_that_can_be_seen() {
        let document = charts_json(&[super::super::example()]);
        assert_eq!(
            document["charts"][0]["panels"][0]["marks"][0]["y"][1],
            Value::Null
        );
        assert_eq!(number(0.123_456_789_01), json!(0.123_456_8));
        assert_eq!(number(-1.0e-20), json!(-1.0e-20));
        assert_eq!(number(f64::INFINITY), Value::Null);
    }

    #[test]
    fn a_long_list_is_written_as_bytes_with_its_gaps() {
        let mut values: Vec<f64> = (0..PACKED_FROM).map(|k| k as f64 / 7.0).collect();
        values[3] = f64::INFINITY;
        let text = numbers(&values)["f32"].as_str().unwrap().to_owned();
        let bytes = BASE64.decode(text).unwrap();
        let (quads, _) = bytes.as_chunks::<4>();
        assert_eq!(quads.len(), values.len());
        assert!((f64::from(f32::from_le_bytes(quads[255])) - 255.0 / 7.0).abs() < 1e-5);
        assert!(f32::from_le_bytes(quads[3]).is_nan());
        assert!(numbers(&values[1..]).is_array(), "a short list can be read");
    }
}
