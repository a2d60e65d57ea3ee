//! Where a command writes its result.

use std::io::{self, ErrorKind, Write};

/// A terminal, file or pipe that remembers whether whoever read it has gone away, which is not our failure.
#[derive(Debug)]
pub(super) struct Output<W> {
    to: W,
    reader_is_gone: bool,
}

impl<W> Output<W> {
    pub(super) const fn new(to: W) -> Self {
        Self {
            to,
            reader_is_gone: false,
        }
    }

    /// Whether something could not be written because nobody reads it any more.
    pub(super) const fn reader_is_gone(&self) -> bool {
        self.reader_is_gone
    }

    fn heard<T>(&mut self, outcome: io::Result<T>) -> io::Result<T> {
        let is_gone = |error: &io::Error| error.kind() == ErrorKind::BrokenPipe;
        self.reader_is_gone |= outcome.as_ref().is_err_and(is_gone);
        outcome
    }
}

impl<W: Write> Write for Output<W> {
    fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
        let outcome = self.to.write(bytes);
        self.heard(outcome)
    }

    fn flush(&mut self) -> io::Result<()> {
        let outcome = self.to.flush();
        self.heard(outcome)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A writer that fails.
    struct Failing(ErrorKind);

    impl Write for Failing {
        fn write(&mut self, _: &[u8]) -> io::Result<usize> {
            Err(self.0.into())
        }

        fn flush(&mut self) -> io::Result<()> {
            Err(self.0.into())
        }
    }

    #[test]
    fn a_reader_that_goes_away_is_told_from_a_disk_that_is_full() {
        for (kind, is_gone) in [
            (ErrorKind::BrokenPipe, true),
            (ErrorKind::StorageFull, false),
        ] {
            let mut output = Output::new(Failing(kind));
            assert!(!output.reader_is_gone());
            assert!(writeln!(output, "a result").is_err());
            assert_eq!(output.reader_is_gone(), is_gone, "{kind}");
            let mut output = Output::new(Failing(kind));
            assert!(output.flush().is_err());
            assert_eq!(output.reader_is_gone(), is_gone, "{kind}");
        }
    }
}
