//! Version 1 of the wire.

mod batch;
mod batch_cbor;
mod batch_error;
mod batch_json;
mod cbor;
mod comparison;
mod decision;
mod diagnosis;
mod errors_of_fit;
mod event;
#[cfg(test)]
pub(in crate::adapters) mod examples;
mod failures;
mod half;
mod identification;
mod improvement;
mod json;
mod parameter_set;
mod profile;
mod recording;
mod solutions;
mod units;
mod verdict;
mod waveforms;
mod words;

pub use batch::{BatchLimits, decode_batch};
pub use batch_cbor::encode_batch_cbor;
pub use batch_error::BatchError;
pub use batch_json::encode_batch_json;
pub use comparison::{ComparisonV1, ComparisonsV1, JudgementV1};
pub use decision::{DecisionV1, EvidenceV1};
pub use diagnosis::{
    CandidateV1, DiagnosisCostV1, DiagnosisV1, EffectWorthV1, EventSetsV1, FittedStructureV1,
    GeneralFormV1, StructureErrorsV1, UnexplainedTermV1, UnexplainedV1, UntestableV1,
};
pub use errors_of_fit::{ErrorSummaryV1, EventErrorsV1};
pub use event::{EventSummaryV1, ReasonV1, ScreeningV1, encode_event_summary};
pub use failures::{BinV1, CrossCorrelationV1, DependenceV1, EventFailureV1, SegmentResidualV1};
pub use identification::{
    CostV1, DirectionV1, IdentificationV1, RefusedV1, SolutionV1, decode_identified_set,
};
pub use improvement::{ImprovementEndV1, ImprovementStepV1, ImprovementV1};
pub(in crate::adapters) use json::rfc3339;
pub use parameter_set::{
    BasesV1, OperatingPointV1, ParameterSetV1, ParameterV1, decode_parameter_set,
    encode_parameter_set,
};
pub use profile::{ConfidenceIntervalV1, LimitV1, ProfilePointV1, ProfileV1, SiteProfileV1};
pub use recording::{
    RecordingError, RecordingFiles, RecordingLimits, decode_recording, encode_recording,
};
pub use solutions::{DirectionProfileV1, ScanMinimumV1, ScanV1, SolutionsV1, ended_name};
pub use units::{accepted_units, channel_name};
pub use verdict::{ChannelVerdictV1, VerdictV1};
pub use waveforms::{WaveformError, decode_waveforms, encode_waveforms};
pub use words::{closing_name, outcome_name, trigger_name, verdict_status_name};
pub(in crate::adapters) use words::{closing_named, trigger_named, verdict_status_named};

/// The version this module reads and writes, in the field `v`.
pub const VERSION: u64 = 1;
