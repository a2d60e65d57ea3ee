//! What a fit or a diagnosis depends on, as one hash: the same hash, the same result.

use serde_json::{Value, json};

use super::structures::versioned;
use crate::{adapters::wire::content_hash, service::ServiceOptions};

/// Hash of the windows, the model and the settings of a fit, and of the program's version. A
/// window's identifier stands for its waveforms: the store keeps the first ones under it. `turn` is
/// which time it is that the site takes the structure up: 0 for the fit of one event, which nobody
/// decides on.
pub(super) fn inputs_hash(
    windows: &[String],
    structure: &[String],
    turn: usize,
    options: &ServiceOptions,
) -> String {
    let inputs = json!({
        "windows": windows,
        "structure": versioned(structure),
        "identification": format!("{:?}", options.identification),
        "program": env!("CARGO_PKG_VERSION"),
    });
    content_hash(&in_turn(inputs, turn))
}

/// The same of a diagnosis, which depends on every effect that there is.
pub(super) fn diagnosis_hash(
    windows: &[String],
    structure: &[String],
    turn: usize,
    options: &ServiceOptions,
) -> String {
    let declared = crate::load_model::effects::catalogue().iter();
    let effects: Vec<String> = declared
        .map(|effect| effect.declaration())
        .map(|declaration| format!("{} {}", declaration.name, declaration.version))
        .collect();
    let inputs = json!({
        "windows": windows,
        "structure": versioned(structure),
        "effects": effects,
        "diagnosis": format!("{:?}", options.diagnosis),
        "program": env!("CARGO_PKG_VERSION"),
    });
    content_hash(&in_turn(inputs, turn))
}

/// The first time goes without saying: what is on record keeps its hash.
fn in_turn(mut inputs: Value, turn: usize) -> Value {
    if turn > 0 {
        inputs["turn"] = json!(turn);
    }
    inputs
}

#[cfg(test)]
mod tests {
    use super::*;

    fn names(names: &[&str]) -> Vec<String> {
        names.iter().map(|&name| name.to_owned()).collect()
    }

    #[test]
    fn the_hash_tells_windows_and_structures_apart() {
        let options = ServiceOptions::default();
        let (windows, base) = (names(&["a", "b"]), names(&["zip", "induction_motor"]));
        for hash in [inputs_hash, diagnosis_hash] {
            let both = hash(&windows, &base, 0, &options);
            assert_eq!(both, hash(&windows, &base, 0, &options));
            assert_ne!(both, hash(&windows[..1], &base, 0, &options));
            assert_ne!(both, hash(&windows, &base, 1, &options), "asked again");
            let more = names(&["zip", "induction_motor", "saturation"]);
            assert_ne!(both, hash(&windows, &more, 0, &options));
        }
        let fit = inputs_hash(&windows, &base, 0, &options);
        assert_ne!(fit, diagnosis_hash(&windows, &base, 0, &options));
    }
}
