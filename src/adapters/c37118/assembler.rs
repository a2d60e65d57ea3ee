//! A CFG-3 from its frames.

use thiserror::Error as ThisError;

use super::{
    configuration::Configuration,
    configuration_variable::{self, ConfigurationPart, INDEX_FIRST, INDEX_LAST, INDEX_ONLY},
    error::Error,
};

/// Most bytes of one configuration. A data frame has room for 16 000 phasors; with names of 30
/// bytes their configuration has 700 kB.
const BYTES_MAX: usize = 1 << 20;

/// Why a part was thrown away, and with it the parts before it.
#[derive(Clone, Debug, PartialEq, Eq, ThisError)]
#[non_exhaustive]
pub enum AssemblyError {
    /// The part is not the one that follows.
    #[error("part {found} of a CFG-3 arrived where part {expected} was due")]
    OutOfOrder {
        /// `CONT_IDX` of the part.
        found: u16,
        /// `CONT_IDX` that was due (or the mark of the last part).
        expected: u16,
    },
    /// The parts are of different streams.
    #[error("a part of the CFG-3 of stream {found} arrived within that of stream {expected}")]
    OtherStream {
        /// IDCODE of the part.
        found: u16,
        /// IDCODE of the parts before it.
        expected: u16,
    },
    /// More bytes than a configuration may have.
    #[error("a CFG-3 has more than {max} bytes")]
    TooLong {
        /// The limit.
        max: usize,
    },
    /// The joined parts are no configuration.
    #[error(transparent)]
    Malformed(#[from] Error),
}

/// Joins the parts of a CFG-3 in the order in which a stream brings them. Memory: at most 1 MiB.
#[derive(Clone, Debug, Default)]
pub struct ConfigurationAssembler {
    /// First part's prefix with the bytes so far, and the index that is due.
    open: Option<(ConfigurationPart, u16)>,
}

impl ConfigurationAssembler {
    /// An assembler that waits for a first part.
    #[must_use]
    pub const fn new() -> Self {
        Self { open: None }
    }

    /// Takes one part; gives the configuration when it is complete. After an error it waits for
    /// a first part again.
    ///
    /// # Errors
    /// The part does not follow the one before it, or the whole is malformed.
    pub fn push(
        &mut self,
        part: ConfigurationPart,
    ) -> Result<Option<Configuration>, AssemblyError> {
        let open = self.open.take();
        match (part.index, open) {
            (INDEX_ONLY, _) => Ok(Some(configuration_variable::read(
                part.prefix,
                &part.bytes,
            )?)),
            (INDEX_FIRST, _) => {
                self.open = Some((part, INDEX_FIRST + 1));
                Ok(None)
            }
            (found, None) => Err(AssemblyError::OutOfOrder {
                found,
                expected: INDEX_FIRST,
            }),
            (found, Some((whole, due))) => self.append(part, found, whole, due),
        }
    }

    fn append(
        &mut self,
        part: ConfigurationPart,
        found: u16,
        mut whole: ConfigurationPart,
        due: u16,
    ) -> Result<Option<Configuration>, AssemblyError> {
        if part.prefix.id_code != whole.prefix.id_code {
            return Err(AssemblyError::OtherStream {
                found: part.prefix.id_code,
                expected: whole.prefix.id_code,
            });
        }
        if found != due && found != INDEX_LAST {
            let expected = due;
            return Err(AssemblyError::OutOfOrder { found, expected });
        }
        if whole.bytes.len() + part.bytes.len() > BYTES_MAX {
            return Err(AssemblyError::TooLong { max: BYTES_MAX });
        }
        whole.bytes.extend(part.bytes);
        if found == INDEX_LAST {
            let configuration = configuration_variable::read(whole.prefix, &whole.bytes)?;
            return Ok(Some(configuration));
        }
        self.open = Some((whole, due.saturating_add(1)));
        Ok(None)
    }
}
