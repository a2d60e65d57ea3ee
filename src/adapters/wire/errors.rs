//! What can be wrong with a JSON document of ours that is read back.

/// Why a document cannot be written or read.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum DocumentError {
    /// It is not JSON, or not of the shape expected.
    #[error("the {document} is not what it should be: {source}")]
    Malformed {
        /// Kind of document.
        document: &'static str,
        /// Where and why.
        source: serde_json::Error,
    },
    /// Its format version is not known here.
    #[error("the {document} has format version {found}, this program knows version {known}")]
    UnknownVersion {
        /// Kind of document.
        document: &'static str,
        /// Version found.
        found: u64,
        /// Version known.
        known: u64,
    },
    /// Its content does not have the hash it carries: it was changed, or damaged.
    #[error("the {document} has the content hash {computed}, not {stated} as it says")]
    HashDiffers {
        /// Kind of document.
        document: &'static str,
        /// Hash written in it.
        stated: String,
        /// Hash of its content.
        computed: String,
    },
    /// A field holds a word that is not in its list.
    #[error("the {document} has `{found}` as its {field}, which is not one of: {known}")]
    UnknownWord {
        /// Kind of document.
        document: &'static str,
        /// Field.
        field: &'static str,
        /// Word found.
        found: String,
        /// Words known.
        known: String,
    },
    /// The waveforms cannot be unpacked.
    #[error(transparent)]
    Waveforms(#[from] super::v1::WaveformError),
}
