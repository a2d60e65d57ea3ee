//! Fewer points for the same picture: curves keep their extremes, tables keep the event.

/// Indices of at most about `points_max` samples of `values` that draw the same curve: of every
/// bucket the first, lowest, highest and last sample, and one missing sample where there is one,
/// so that gaps stay gaps. All indices when there are few enough.
pub(in crate::adapters) fn envelope(values: &[f64], points_max: usize) -> Vec<usize> {
    const KEPT_PER_BUCKET: usize = 5;
    if values.len() <= points_max {
        return (0..values.len()).collect();
    }
    let bucket = values
        .len()
        .div_ceil((points_max / KEPT_PER_BUCKET).max(1))
        .max(1);
    let mut kept = Vec::with_capacity(points_max);
    for start in (0..values.len()).step_by(bucket) {
        let end = (start + bucket).min(values.len());
        kept.extend(bucket_envelope(values, start, end));
    }
    kept
}

fn bucket_envelope(values: &[f64], start: usize, end: usize) -> Vec<usize> {
    let mut kept = vec![start, end - 1];
    let finite = || (start..end).filter(|&k| values[k].is_finite());
    kept.extend(finite().min_by(|&a, &b| values[a].total_cmp(&values[b])));
    kept.extend(finite().max_by(|&a, &b| values[a].total_cmp(&values[b])));
    kept.extend((start..end).find(|&k| !values[k].is_finite()));
    kept.sort_unstable();
    kept.dedup();
    kept
}

/// Indices of at most `rows_max` samples for a table: half of the rows go to samples with
/// `important` set, evenly thinned, the rest to all samples, evenly thinned.
pub(in crate::adapters) fn rows(important: &[bool], rows_max: usize) -> Vec<usize> {
    let marked: Vec<_> = (0..important.len()).filter(|&k| important[k]).collect();
    let mut kept = thinned(&marked, rows_max / 2);
    let all: Vec<_> = (0..important.len()).collect();
    kept.extend(thinned(&all, rows_max - kept.len()));
    kept.sort_unstable();
    kept.dedup();
    kept
}

/// At most `count_max` of `items`, evenly spaced, the first among them.
pub(in crate::adapters) fn thinned(items: &[usize], count_max: usize) -> Vec<usize> {
    if count_max == 0 {
        return Vec::new();
    }
    let step = items.len().div_ceil(count_max).max(1);
    items.iter().copied().step_by(step).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn an_envelope_keeps_a_lone_spike_and_a_lone_gap() {
        let mut values = vec![1.0; 10_000];
        values[4_321] = 9.0;
        values[7_777] = f64::NAN;
        let kept = envelope(&values, 500);
        assert!(kept.len() <= 500, "{}", kept.len());
        assert!(kept.contains(&4_321) && kept.contains(&7_777));
        assert!(kept.is_sorted());
    }

    #[test]
    fn few_samples_are_all_kept() {
        assert_eq!(envelope(&[1.0, 2.0], 500), [0, 1]);
        assert_eq!(rows(&[false; 3], 10), [0, 1, 2]);
        assert!(rows(&[], 10).is_empty());
    }

    #[test]
    fn table_rows_favour_what_is_important() {
        let important: Vec<_> = (0..1000).map(|k| (100..140).contains(&k)).collect();
        let kept = rows(&important, 100);
        assert!(kept.len() <= 100);
        let inside = kept.iter().filter(|k| (100..140).contains(*k)).count();
        assert!(inside >= 40, "{inside}");
    }
}
