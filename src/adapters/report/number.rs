//! Numbers as a reader wants them: significant digits, no exponent where none is needed.

/// What stands where there is no number.
pub(in crate::adapters) const ABSENT: &str = "–";

/// `value` with `digits` significant digits; an exponent only below 1e-4 or from 1e6 on.
pub(in crate::adapters) fn significant(value: f64, digits: usize) -> String {
    if !value.is_finite() {
        return ABSENT.to_owned();
    }
    if value == 0.0 {
        return "0".to_owned();
    }
    let magnitude = value.abs().log10().floor();
    if !(-4.0..6.0).contains(&magnitude) {
        return format!("{value:.*e}", digits.saturating_sub(1)).replace('-', "\u{2212}");
    }
    fixed(value, decimals_for(magnitude, digits))
}

/// `value` as short as it can be said with five significant digits: `200`, `59.94`.
pub(in crate::adapters) fn short(value: f64) -> String {
    let text = significant(value, 5);
    if text.contains('.') && !text.contains('e') {
        return text.trim_end_matches('0').trim_end_matches('.').to_owned();
    }
    text
}

/// `value` with a fixed number of decimals and a true minus sign; never "-0".
pub(in crate::adapters) fn fixed(value: f64, decimals: usize) -> String {
    if !value.is_finite() {
        return ABSENT.to_owned();
    }
    let text = format!("{value:.decimals$}");
    match text.strip_prefix('-') {
        Some(digits) if digits.chars().all(|c| c == '0' || c == '.') => digits.to_owned(),
        Some(digits) => format!("\u{2212}{digits}"),
        None => text,
    }
}

/// Decimals with which ticks over `span` can be told apart, 0 to 8.
pub(in crate::adapters) fn decimals_for_span(span: f64) -> usize {
    if span.is_finite() && span > 0.0 {
        decimals_for(span.log10().floor(), 2).min(8)
    } else {
        3
    }
}

#[allow(
    clippy::cast_possible_truncation,
    clippy::cast_sign_loss,
    reason = "clamped to 0..=20 in the same expression"
)]
fn decimals_for(magnitude: f64, digits: usize) -> usize {
    (digits as f64 - 1.0 - magnitude).clamp(0.0, 20.0) as usize
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn significant_digits_are_kept_across_magnitudes() {
        assert_eq!(significant(0.012_345, 3), "0.0123");
        assert_eq!(significant(1234.6, 3), "1235");
        assert_eq!(significant(-0.5, 2), "\u{2212}0.50");
        assert_eq!(significant(-1.5e-7, 2), "\u{2212}1.5e\u{2212}7");
        assert_eq!(significant(f64::NAN, 3), ABSENT);
    }

    #[test]
    fn a_round_number_is_said_without_zeros_after_the_point() {
        assert_eq!(short(200.0), "200");
        assert_eq!(short(59.94), "59.94");
        assert_eq!(short(100_000.0), "100000");
    }

    #[test]
    fn a_rounded_zero_carries_no_sign() {
        assert_eq!(fixed(-0.000_4, 3), "0.000");
        assert_eq!(fixed(-0.000_6, 3), "\u{2212}0.001");
    }

    #[test]
    fn ticks_over_a_small_span_differ() {
        assert_eq!(decimals_for_span(0.02), 3);
        assert_eq!(decimals_for_span(10.0), 0);
        assert_eq!(decimals_for_span(0.0), 3);
    }
}
