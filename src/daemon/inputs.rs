//! What a fit depends on, as one hash: the same hash, the same fit.

use serde_json::json;

use crate::{adapters::wire::content_hash, service::ServiceOptions};

/// Hash of the windows, the model and the settings of a fit, and of the program's version. A
/// window's identifier stands for its waveforms: the store keeps the first ones under it.
pub(super) fn inputs_hash(windows: &[String], options: &ServiceOptions) -> String {
    content_hash(&json!({
        "windows": windows,
        "structure": options.structure,
        "identification": format!("{:?}", options.identification),
        "program": env!("CARGO_PKG_VERSION"),
    }))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_hash_tells_windows_and_structures_apart() {
        let options = ServiceOptions::default();
        let windows = ["a".to_owned(), "b".to_owned()];
        let both = inputs_hash(&windows, &options);
        assert_eq!(both, inputs_hash(&windows, &options));
        assert_ne!(both, inputs_hash(&windows[..1], &options));
        let other = ServiceOptions {
            structure: vec!["zip".to_owned()],
            ..options
        };
        assert_ne!(both, inputs_hash(&windows, &other));
    }
}
