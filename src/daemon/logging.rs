//! Where log lines go: to the journal when systemd has started us, else to standard error.

use std::{
    io::{self, IsTerminal},
    os::unix::fs::MetadataExt,
};

use tracing_subscriber::{
    EnvFilter, Layer, Registry, layer::SubscriberExt, util::SubscriberInitExt,
};

/// How log lines are written.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Default)]
pub enum LogFormat {
    /// To the journal when standard error is connected to it, else as text.
    #[default]
    Auto,
    /// Lines of text on standard error.
    Text,
    /// One JSON object per line on standard error.
    Json,
}

/// Why logging could not be set up.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum LogError {
    /// The filter cannot be understood.
    #[error("the log filter `{filter}` is not valid: {reason}")]
    Filter {
        /// The filter.
        filter: String,
        /// What is wrong with it.
        reason: String,
    },
    /// The journal cannot be reached.
    #[error("cannot log to the journal: {0}")]
    Journal(#[source] io::Error),
    /// Logging was set up before.
    #[error("logging is set up already")]
    Twice,
}

/// Sets logging up for the whole process. `filter` is of the form `info,zenoh=warn`.
///
/// # Errors
///
/// [`LogError`].
pub fn set_up(format: LogFormat, filter: &str) -> Result<(), LogError> {
    let filter_layer = EnvFilter::try_new(filter).map_err(|error| LogError::Filter {
        filter: filter.to_owned(),
        reason: error.to_string(),
    })?;
    let text = tracing_subscriber::fmt::layer()
        .with_writer(io::stderr)
        .with_ansi(io::stderr().is_terminal());
    let layer: Box<dyn Layer<Registry> + Send + Sync> = match format {
        LogFormat::Auto if under_systemd() => {
            Box::new(tracing_journald::layer().map_err(LogError::Journal)?)
        }
        LogFormat::Auto | LogFormat::Text => Box::new(text),
        LogFormat::Json => Box::new(text.json().flatten_event(true)),
    };
    tracing_subscriber::registry()
        .with(layer.with_filter(filter_layer))
        .try_init()
        .map_err(|_| LogError::Twice)
}

/// Whether systemd has connected our standard error to the journal: it names the device and inode
/// of that stream (`systemd.exec(5)`), which a child with another standard error inherits too.
fn under_systemd() -> bool {
    let Ok(stream) = std::env::var("JOURNAL_STREAM") else {
        return false;
    };
    std::fs::metadata("/proc/self/fd/2")
        .is_ok_and(|file| stream == format!("{}:{}", file.dev(), file.ino()))
}
