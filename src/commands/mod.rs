//! The command line: one file per command, and this table.
//!
//! A command is a line in `Command`, an arm in `dispatch`, and a module with its arguments
//! (`clap::Args`) and `run(&args, out)`, which writes its result to `out` and its troubles to the
//! error it returns. Exit codes: 0 done, 1 failed, 64 used wrongly (`sysexits.h`).

pub mod bridge;
pub mod check_config;
pub mod compare;
mod connection;
pub mod demo;
pub mod diagnose;
mod diagnosing;
pub mod effects;
mod error;
mod fitting;
pub mod generate;
pub mod identify;
pub mod improve;
pub mod inspect;
pub mod misuse;
mod output;
pub mod profile;
pub mod replay;
pub mod run;
pub mod solutions;
mod source;
pub mod structure;
pub mod subscribe;
mod target;

use std::{
    io::{self, Write},
    path::{Path, PathBuf},
    process::ExitCode,
    time::Duration,
};

use clap::{Args, CommandFactory, Parser, Subcommand};
use tokio::{
    runtime,
    signal::unix::{SignalKind, signal},
};

pub use error::Error;

use self::output::Output;
use crate::config::Config;

/// Turns PMU and disturbance-recorder streams into proven load models.
#[derive(Debug, Parser)]
#[command(name = "loadmodeld", version, about, long_about = None, after_help = AFTER_HELP)]
struct CommandLine {
    /// Effect written in a TOML file, beside those of the catalogue (`generate` does not know it); may be given several
    /// times
    #[arg(long = "effect-file", value_name = "FILE", global = true)]
    effect_files: Vec<PathBuf>,
    #[command(subcommand)]
    command: Command,
}

const AFTER_HELP: &str = "Exit codes: 0 done, 1 failed, 64 used wrongly.";

/// Used wrongly: `EX_USAGE` of `sysexits.h`.
const EXIT_USAGE: u8 = 64;
/// Failed.
const EXIT_FAILURE: u8 = 1;
/// Longest wait for threads that still work when a command has ended.
const RUNTIME_END_LIMIT: Duration = Duration::from_secs(1);

#[derive(Debug, Subcommand)]
enum Command {
    /// Run the daemon
    Run(run::RunArgs),
    /// Tell every problem of a configuration at once; exit 1 when there is one
    CheckConfig(check_config::CheckConfigArgs),
    /// Show all of it on this machine: daemon, bundled recordings replayed live, page
    Demo(demo::DemoArgs),
    /// Publish recordings over zenoh with their original timing or faster
    Replay(replay::ReplayArgs),
    /// Publish what a PMU or concentrator sends over zenoh
    Bridge(bridge::BridgeArgs),
    /// Print parameter sets, or diagnoses, as they are published
    Subscribe(subscribe::SubscribeArgs),
    /// Hold a model against the measurements of a site folder: table and report with plots
    Compare(compare::CompareArgs),
    /// Fit a site folder, list all solutions, validate
    Identify(identify::IdentifyArgs),
    /// Say where the model fails and which effect is missing
    Diagnose(diagnose::DiagnoseArgs),
    /// Add what is missing, refit, until nothing more is; show the error fall
    Improve(improve::ImproveArgs),
    /// Follow the profile likelihood of parameters: confidence intervals, plot
    Profile(profile::ProfileArgs),
    /// Tell every local solution of a fit, how each was found, and whether a scan finds more
    Solutions(solutions::SolutionsArgs),
    /// Say what is in a COMTRADE file, a site folder or a file of C37.118 frames
    Inspect(inspect::InspectArgs),
    /// List effects, show one, check effect files
    Effects(effects::EffectsArgs),
    /// Show or change which model a site of a service is to have
    Structure(structure::StructureArgs),
    /// Make synthetic sites whose truth is known
    Generate(generate::GenerateArgs),
    /// Print a completion script for a shell
    Completions(CompletionsArgs),
    /// Print the manual page
    Man,
}

impl Command {
    /// The configuration that a command fits by.
    fn config(&self) -> Option<&Path> {
        let source = match self {
            Self::Identify(args) => &args.source,
            Self::Compare(args) => &args.source,
            Self::Diagnose(args) => &args.common.source,
            Self::Improve(args) => &args.common.source,
            Self::Profile(args) => &args.source,
            Self::Solutions(args) => &args.source,
            _ => return None,
        };
        source.config.as_deref()
    }
}

/// `effect_files` are those of the command line. A configuration may name more, and all must be made
/// known at one time.
fn dispatch(command: Command, effect_files: &[PathBuf], out: &mut dyn Write) -> Result<(), Error> {
    match (&command, command.config()) {
        (Command::Run(_) | Command::CheckConfig(_), _) => {}
        (_, Some(path)) => {
            let config = Config::load(path)?;
            config.register_effects(effect_files, &path.display().to_string())?;
        }
        (_, None) => effects::register(effect_files)?,
    }
    match command {
        Command::Run(args) => run::run(&args, effect_files),
        Command::CheckConfig(args) => {
            if check_config::run(&args, effect_files, out)? {
                Ok(())
            } else {
                Err(Error::UnusableConfiguration)
            }
        }
        Command::Demo(args) => demo::run(&args, out),
        Command::Replay(args) => replay::run(&args, out),
        Command::Bridge(args) => bridge::run(&args, out),
        Command::Subscribe(args) => subscribe::run(&args, out),
        Command::Identify(args) => identify::run(&args, out).map_err(Error::of),
        Command::Compare(args) => compare::run(&args, out).map_err(Error::of),
        Command::Diagnose(args) => diagnose::run(&args, out).map_err(Error::of),
        Command::Improve(args) => improve::run(&args, out).map_err(Error::of),
        Command::Profile(args) => profile::run(&args, out).map_err(Error::of),
        Command::Solutions(args) => solutions::run(&args, out).map_err(Error::of),
        Command::Inspect(args) => inspect::run(&args, out).map_err(Error::other),
        Command::Effects(args) => effects::run(&args, out),
        Command::Structure(args) => structure::run(&args, out),
        Command::Generate(args) => generate::run(&args, out).map_err(Error::other),
        Command::Completions(args) => completions(&args, out),
        Command::Man => manual(out),
    }
}

/// Arguments of `completions`.
#[derive(Debug, Args)]
struct CompletionsArgs {
    /// Shell
    shell: clap_complete::Shell,
}

/// Parses the command line and runs the command.
#[must_use]
pub fn main() -> ExitCode {
    let command_line = match CommandLine::try_parse() {
        Ok(command_line) => command_line,
        Err(error) => {
            // Nothing can be done about a terminal that does not take the message.
            error.print().ok();
            return ExitCode::from(if error.use_stderr() { EXIT_USAGE } else { 0 });
        }
    };
    let mut output = Output::new(io::stdout().lock());
    let outcome = dispatch(
        command_line.command,
        &command_line.effect_files,
        &mut output,
    );
    let Err(error) = outcome else {
        return ExitCode::SUCCESS;
    };
    if output.reader_is_gone() {
        return ExitCode::SUCCESS;
    }
    // As above.
    writeln!(io::stderr(), "loadmodeld: {error}").ok();
    ExitCode::from(if error.is_usage() {
        EXIT_USAGE
    } else {
        EXIT_FAILURE
    })
}

/// Runs a command that talks to others on a runtime of its own. Computing has other threads; a
/// thread that hangs (a dead disk) does not keep the program from ending.
fn block_on<T>(command: impl Future<Output = Result<T, Error>>) -> Result<T, Error> {
    let runtime = runtime::Builder::new_multi_thread()
        .worker_threads(2)
        .enable_all()
        .build()?;
    let result = runtime.block_on(command);
    runtime.shutdown_timeout(RUNTIME_END_LIMIT);
    result
}

/// Is ready when the user or the system asks the program to end.
async fn asked_to_end() -> Result<(), Error> {
    let mut terminate = signal(SignalKind::terminate())?;
    let mut interrupt = signal(SignalKind::interrupt())?;
    tokio::select! {
        _ = terminate.recv() => {}
        _ = interrupt.recv() => {}
    }
    Ok(())
}

fn completions(args: &CompletionsArgs, out: &mut dyn Write) -> Result<(), Error> {
    let mut script = Vec::new();
    clap_complete::generate(
        args.shell,
        &mut CommandLine::command(),
        "loadmodeld",
        &mut script,
    );
    Ok(out.write_all(&script)?)
}

fn manual(out: &mut dyn Write) -> Result<(), Error> {
    let page = clap_mangen::Man::new(CommandLine::command());
    let mut text = Vec::new();
    page.render(&mut text)?;
    let mut command = CommandLine::command();
    command.build();
    for subcommand in command.get_subcommands().filter(|c| !c.is_hide_set()) {
        let page = clap_mangen::Man::new(subcommand.clone());
        writeln!(text, ".SH {}", subcommand.get_name().to_uppercase())?;
        page.render_synopsis_section(&mut text)?;
        page.render_description_section(&mut text)?;
        page.render_options_section(&mut text)?;
    }
    Ok(out.write_all(&text)?)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_command_line_is_well_formed() {
        CommandLine::command().debug_assert();
    }

    #[test]
    fn the_manual_page_names_every_command() {
        let mut page = Vec::new();
        manual(&mut page).unwrap();
        let page = String::from_utf8(page).unwrap();
        for name in ["RUN", "DEMO", "REPLAY", "BRIDGE", "SUBSCRIBE"] {
            assert!(page.contains(&format!(".SH {name}")), "{name}");
        }
    }

    #[test]
    fn a_completion_script_knows_the_commands() {
        let mut script = Vec::new();
        let args = CompletionsArgs {
            shell: clap_complete::Shell::Bash,
        };
        completions(&args, &mut script).unwrap();
        assert!(String::from_utf8(script).unwrap().contains("subscribe"));
    }

    #[test]
    fn an_unknown_option_is_wrong_usage() {
        let error = CommandLine::try_parse_from(["loadmodeld", "run", "--no-such"]).unwrap_err();
        assert!(error.use_stderr());
    }
}
