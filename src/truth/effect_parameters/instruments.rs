//! The parameters of errors of instruments.

use super::{EffectParameter, quantity, signed};

pub(super) const TIME_SKEW: &[EffectParameter] = &[signed(
    "skew_s",
    (0.009, 0.03),
    (-0.5, 0.5),
    "by how much P and Q are late",
)];

pub(super) const PHASOR_WINDOW: &[EffectParameter] = &[quantity(
    "cycles",
    (4.0, 6.0),
    (0.0, 20.0),
    "whole width of the phasor window, nominal cycles",
)];

pub(super) const RATIO_PHASE_ERROR: &[EffectParameter] = &[signed(
    "angle_deg",
    (0.4, 1.5),
    (-15.0, 15.0),
    "angle by which the current is measured too far ahead",
)];

pub(super) const FREQUENCY_TRACKING: &[EffectParameter] = &[
    quantity(
        "lag_s",
        (0.05, 0.2),
        (0.0, 2.0),
        "lag of the frequency estimate",
    ),
    quantity(
        "span_cycles",
        (0.25, 0.5),
        (0.05, 10.0),
        "cycles to either side over which the angle is differenced",
    ),
];
