//! What a diagnosis cannot say: effects that the events do not test, and what nothing of the catalogue explains.

use std::io::{self, Write};

use crate::diagnosis::{Diagnosis, GeneralForm, Unexplained, Untestable};

/// What cannot be tested, and what nothing explains.
pub(in crate::commands) fn print_limits(
    diagnosis: &Diagnosis,
    out: &mut dyn Write,
) -> io::Result<()> {
    if !diagnosis.untestable.is_empty() {
        writeln!(out, "\nnot testable with these events")?;
    }
    for effect in &diagnosis.untestable {
        print_untestable(effect, out)?;
    }
    match &diagnosis.unexplained {
        Some(unexplained) => print_unexplained(unexplained, out),
        None => Ok(()),
    }
}

fn print_untestable(effect: &Untestable, out: &mut dyn Write) -> io::Result<()> {
    let unit = match effect.unit.as_str() {
        "1" => String::new(),
        unit => format!(" {unit}"),
    };
    if !effect.smallest_detectable_amplitude.is_finite() {
        return writeln!(
            out,
            "  {}: no {} would have shown; {}",
            effect.effect, effect.amplitude, effect.needs
        );
    }
    writeln!(
        out,
        "  {}: {} shows from {:.3}{unit} on, and {:.3}{unit} would matter; {}",
        effect.effect,
        effect.amplitude,
        effect.smallest_detectable_amplitude,
        effect.meaningful_amplitude,
        effect.needs
    )
}

fn print_unexplained(unexplained: &Unexplained, out: &mut dyn Write) -> io::Result<()> {
    writeln!(out, "\nnot in the catalogue: {}", unexplained.signature)?;
    if let Some(form) = &unexplained.general_form {
        print_general_form(form, out)?;
    }
    for term in &unexplained.terms {
        writeln!(
            out,
            "  {} {:+.4} x {}  explains {:.0} %",
            term.channel,
            term.coefficient,
            term.formula,
            100.0 * term.share
        )?;
    }
    let described = unexplained.effect_file.as_ref();
    if let Some(file) = described.filter(|_| unexplained.general_form.is_none()) {
        writeln!(out, "  as a file for --effect-file:\n")?;
        for line in file.lines() {
            writeln!(out, "    {line}")?;
        }
    }
    Ok(())
}

fn print_general_form(form: &GeneralForm, out: &mut dyn Write) -> io::Result<()> {
    write!(
        out,
        "  general form {} (to add it: improve --add {0}): {}\n  misfit per sample {:.2} -> {:.2}",
        form.name, form.title, form.misfit_before, form.misfit_after
    )?;
    if let (Some(before), Some(after)) = (form.held_out_error_before, form.held_out_error_after) {
        write!(
            out,
            ", its root on held-out events {before:.2} -> {after:.2}"
        )?;
    }
    writeln!(out)?;
    for parameter in &form.parameters {
        let error = parameter.standard_error;
        let error = error.map_or_else(|| "-".to_owned(), |error| format!("{error:.5}"));
        let unit = if parameter.unit == "1" {
            ""
        } else {
            &parameter.unit
        };
        let line = format!(
            "    {:44} {:>9.5}  {error:>9}  {unit}",
            parameter.name, parameter.value
        );
        writeln!(out, "{}", line.trim_end())?;
    }
    writeln!(out, "  as fitted, a file for --effect-file:\n")?;
    for line in form.effect_file.lines() {
        writeln!(out, "    {line}")?;
    }
    writeln!(out)
}
