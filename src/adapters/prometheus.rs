//! Metrics in the Prometheus text format.

use prometheus::TextEncoder;

use crate::telemetry::Metrics;

/// Content type of the text format.
pub const CONTENT_TYPE: &str = prometheus::TEXT_FORMAT;

/// Renders all metrics.
///
/// # Errors
///
/// When a family holds no metric, which the registry does not hand out.
pub fn render(metrics: &Metrics) -> Result<String, prometheus::Error> {
    TextEncoder::new().encode_to_string(&metrics.gather())
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::telemetry::catalogue::SAMPLES;

    #[test]
    fn a_counter_is_rendered_with_its_labels() {
        let metrics = Metrics::new().unwrap();
        metrics.add(&SAMPLES, &["north", "late"], 2);
        let text = render(&metrics).unwrap();
        let line = r#"loadmodeld_samples_total{outcome="late",site="north"} 2"#;
        assert!(text.contains(line), "{text}");
        assert!(text.contains("# TYPE loadmodeld_samples_total counter"));
    }
}
