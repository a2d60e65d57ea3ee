//! `loadmodeld run`: the daemon.

use std::{
    path::{Path, PathBuf},
    sync::Arc,
};

use clap::Args;

use super::Error;
use crate::{
    config::{Config, LogFormatConfig},
    daemon::{
        self, Settings,
        logging::{self, LogFormat},
    },
};

/// Arguments of `run`.
#[derive(Debug, Args)]
pub struct RunArgs {
    /// Configuration; `check-config` tells what is wrong with one
    #[arg(long, value_name = "FILE")]
    config: PathBuf,
}

/// Runs the daemon until SIGTERM or SIGINT, with the effects of `effect_files` beside those that the
/// configuration names.
///
/// # Errors
///
/// [`Error`] when the configuration cannot be used, or the daemon does not start or end well.
pub fn run(args: &RunArgs, effect_files: &[PathBuf]) -> Result<(), Error> {
    let config = Config::load(&args.config)?;
    config.register_effects(effect_files, &args.config.display().to_string())?;
    let settings = Settings::from_config(&config)?;
    logging::set_up(log_format(config.log.format), &config.log.level)?;
    super::block_on(async {
        let daemon = daemon::start(settings, Arc::new(|_| {})).await?;
        tokio::select! {
            asked = super::asked_to_end() => asked?,
            () = daemon.ended() => {}
        }
        daemon.stop();
        Ok(daemon.join().await?)
    })
}

/// The settings of a configuration file.
pub(super) fn settings(path: &Path) -> Result<Settings, Error> {
    Ok(Settings::from_config(&Config::load(path)?)?)
}

const fn log_format(format: LogFormatConfig) -> LogFormat {
    match format {
        LogFormatConfig::Auto => LogFormat::Auto,
        LogFormatConfig::Text => LogFormat::Text,
        LogFormatConfig::Json => LogFormat::Json,
    }
}
