//! The `loadmodeld` program: parses the command line and hands over to `loadmodeld::commands`.

fn main() -> std::process::ExitCode {
    loadmodeld::commands::main()
}
