//! What validation says of a fit, and what is done with it.

/// The outcome of validation.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum VerdictStatus {
    /// Every test on the held-out events was met.
    Pass,
    /// At least one was not.
    Fail,
    /// The data do not allow a judgement (too few events, no dynamics excited ...).
    CannotJudge,
}

/// Mean error (ME), mean absolute error (MAE) and largest error (MXE) of one channel in one
/// segment of one held-out event, pu of P0.
#[derive(Clone, Debug, PartialEq)]
pub struct ChannelVerdict {
    /// Event.
    pub event: String,
    /// `"P"` or `"Q"`.
    pub channel: &'static str,
    /// `"before"`, `"during"` or `"after"`.
    pub segment: &'static str,
    /// Largest absolute error.
    pub mxe_pu: f64,
    /// Absolute value of the mean error.
    pub me_pu: f64,
    /// Mean absolute error.
    pub mae_pu: f64,
    /// Whether the three are within their limits.
    pub within_limits: bool,
}

/// Verdict with its reasons.
#[derive(Clone, Debug, PartialEq)]
pub struct Verdict {
    /// Pass, fail or cannot judge.
    pub status: VerdictStatus,
    /// Each reason with its number; for a pass, what was shown.
    pub reasons: Vec<String>,
    /// The measured errors against the limits.
    pub channels: Vec<ChannelVerdict>,
}

/// What to do with a validated set.
#[derive(Clone, Debug, PartialEq)]
pub enum Decision {
    /// Publish it as the set in force.
    Publish {
        /// Why.
        reason: String,
    },
    /// Publish it marked as unvalidated, which the configuration allows.
    PublishUnvalidated {
        /// Why.
        reason: String,
    },
    /// Keep it and ask a person.
    AwaitApproval {
        /// Why.
        reason: String,
    },
    /// Keep the set in force.
    Reject {
        /// Why.
        reason: String,
    },
}

impl Decision {
    /// Why, in words.
    #[must_use]
    pub fn reason(&self) -> &str {
        match self {
            Self::Publish { reason }
            | Self::PublishUnvalidated { reason }
            | Self::AwaitApproval { reason }
            | Self::Reject { reason } => reason,
        }
    }

    /// The same, to be added to.
    pub fn reason_mut(&mut self) -> &mut String {
        match self {
            Self::Publish { reason }
            | Self::PublishUnvalidated { reason }
            | Self::AwaitApproval { reason }
            | Self::Reject { reason } => reason,
        }
    }
}
