//! `loadmodeld subscribe`: parameter sets, or diagnoses, as they are published.

use std::io::Write;

use clap::Args;
use serde_json::Value;

use super::{Error, connection::ConnectionArgs};
use crate::adapters::zenoh::{self, Keys, ZenohError, is_chunk};

/// Arguments of `subscribe`.
#[derive(Debug, Args)]
pub struct SubscribeArgs {
    /// Site; all of them when left out
    site: Option<String>,
    /// Print diagnoses, not sets
    #[arg(long)]
    diagnoses: bool,
    /// Print each document as one line of JSON
    #[arg(long)]
    json: bool,
    /// End after so many documents
    #[arg(long, value_name = "N")]
    count: Option<u64>,
    #[command(flatten)]
    connection: ConnectionArgs,
}

/// Prints documents until it is interrupted or has printed as many as were asked for.
///
/// # Errors
///
/// [`Error`] when the daemon cannot be reached or the output not be written.
pub fn run(args: &SubscribeArgs, out: &mut dyn Write) -> Result<(), Error> {
    if let Some(site) = args.site.as_deref()
        && !is_chunk(site)
    {
        return Err(Error::Usage(format!("`{site}` is not the name of a site")));
    }
    super::block_on(subscribe(args, out))
}

async fn subscribe(args: &SubscribeArgs, out: &mut dyn Write) -> Result<(), Error> {
    let options = args.connection.options()?;
    let session = zenoh::open(&options).await?;
    let (keys, site) = (Keys::new(&options.prefix), args.site.as_deref());
    let (key, in_words): (String, fn(&str) -> String) = if args.diagnoses {
        (keys.diagnosis(site.unwrap_or("*")), diagnosis_in_words)
    } else {
        (keys.parameters(site.unwrap_or("*")), in_words)
    };
    let documents = zenoh::documents(&session, &key).await?;
    let mut printed = 0;
    while args.count.is_none_or(|count| printed < count) {
        let document = tokio::select! {
            document = documents.next() => document,
            asked = super::asked_to_end() => {
                asked?;
                break;
            }
        };
        let Some(document) = document else {
            return Err(ZenohError::Closed.into());
        };
        if args.json {
            writeln!(out, "{document}")?;
        } else {
            writeln!(out, "{}", in_words(&document))?;
        }
        out.flush()?;
        printed += 1;
    }
    zenoh::close_within(&session, &options).await;
    Ok(())
}

fn text(value: &Value) -> String {
    value
        .as_str()
        .map_or_else(|| value.to_string(), str::to_owned)
}

fn texts(list: &Value) -> Vec<String> {
    let list = list.as_array().map(Vec::as_slice).unwrap_or_default();
    list.iter().map(text).collect()
}

fn not_json(document: &str) -> String {
    format!("a document that is not JSON: {document}")
}

/// One diagnosis in one line for people.
fn diagnosis_in_words(document: &str) -> String {
    let Ok(diagnosis) = serde_json::from_str::<Value>(document) else {
        return not_json(document);
    };
    let number = |name: &str| {
        let value = diagnosis[name].as_f64();
        value.map_or_else(|| "-".to_owned(), |value| format!("{value:.2}"))
    };
    let answer = match texts(&diagnosis["answer_set"]).join(", ") {
        none if none.is_empty() => String::new(),
        effects => format!(" {effects}"),
    };
    format!(
        "{} diagnosis {} of {}: {}{answer}; error {} times the noise, a perfect model {}; {}",
        text(&diagnosis["site"]),
        text(&diagnosis["version"]),
        texts(&diagnosis["structure"]).join("+"),
        text(&diagnosis["status"]),
        number("error_to_noise"),
        number("noise_floor"),
        text(&diagnosis["summary"]),
    )
}

/// One set in one line for people.
pub(super) fn in_words(document: &str) -> String {
    let Ok(set) = serde_json::from_str::<Value>(document) else {
        return not_json(document);
    };
    let errors = |part: &str| match (&set[part]["eps_p_percent"], &set[part]["eps_q_percent"]) {
        (Value::Number(p), Value::Number(q)) => {
            let (p, q) = (
                p.as_f64().unwrap_or(f64::NAN),
                q.as_f64().unwrap_or(f64::NAN),
            );
            format!("eps_P {p:.3} % eps_Q {q:.3} %")
        }
        _ => "none".to_owned(),
    };
    let parameters: Vec<String> = set["parameters"]
        .as_object()
        .into_iter()
        .flatten()
        .map(|(name, p)| format!("{name}={:.4}", p["value"].as_f64().unwrap_or(f64::NAN)))
        .collect();
    format!(
        "{} version {} {}: {}; fit {}; held out {}; verdict {}",
        text(&set["site"]),
        text(&set["version"]),
        texts(&set["structure"]).join("+"),
        parameters.join(" "),
        errors("fit"),
        errors("held_out"),
        text(&set["verdict"]["status"]),
    )
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_set_is_one_line_of_words() {
        let line = in_words(
            r#"{"site":"north","version":3,"structure":["zip","induction_motor"],
                "parameters":{"M":{"value":1.5}},"fit":{"eps_p_percent":0.5,"eps_q_percent":1},
                "held_out":null,"verdict":{"status":"pass"}}"#,
        );
        assert_eq!(
            line,
            "north version 3 zip+induction_motor: M=1.5000; fit eps_P 0.500 % eps_Q 1.000 %; \
             held out none; verdict pass"
        );
    }

    #[test]
    fn a_diagnosis_is_one_line_of_words() {
        let line = diagnosis_in_words(
            r#"{"site":"north","version":2,"structure":["zip","induction_motor"],"status":"missing_effect",
                "answer_set":["saturation"],"error_to_noise":3.14159,"noise_floor":1.1,
                "summary":"The model lacks saturation."}"#,
        );
        assert_eq!(
            line,
            "north diagnosis 2 of zip+induction_motor: missing_effect saturation; error 3.14 times the noise, \
             a perfect model 1.10; The model lacks saturation."
        );
        let none = r#"{"site":"north","version":2,"structure":[],"status":"cannot_judge","error_to_noise":null}"#;
        assert!(diagnosis_in_words(none).contains("cannot_judge; error - times"));
    }

    #[test]
    fn what_is_not_json_is_said_to_be_so() {
        assert!(in_words("?").contains("not JSON") && diagnosis_in_words("?").contains("not JSON"));
    }
}
