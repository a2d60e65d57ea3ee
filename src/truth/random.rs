//! Random numbers that are the same on every machine: xoshiro256++ seeded by splitmix64.
//!
//! Source: D. Blackman, S. Vigna, "Scrambled linear pseudorandom number generators" (2021);
//! reference implementations at prng.di.unimi.it, public domain, here written anew.

use std::f64::consts::TAU;

/// A seeded generator of random numbers.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Random {
    state: [u64; 4],
}

impl Random {
    /// A generator whose numbers depend on `seed` only.
    #[must_use]
    pub fn new(seed: u64) -> Self {
        let mut expander = seed;
        Self {
            state: std::array::from_fn(|_| splitmix(&mut expander)),
        }
    }

    /// A generator for part `part` of the work, so that one part's use of numbers does not shift
    /// another's.
    #[must_use]
    pub fn for_part(seed: u64, part: u64) -> Self {
        let mut mixed = seed ^ part.wrapping_mul(0xD1B5_4A32_D192_ED03);
        Self::new(splitmix(&mut mixed))
    }

    /// 64 random bits (xoshiro256++).
    pub fn bits(&mut self) -> u64 {
        let [a, b, c, d] = self.state;
        let result = a.wrapping_add(d).rotate_left(23).wrapping_add(a);
        let shifted = b << 17;
        let (c, d) = (c ^ a, d ^ b);
        self.state = [a ^ d, b ^ c, c ^ shifted, d.rotate_left(45)];
        result
    }

    /// Uniform on [0, 1).
    pub fn uniform(&mut self) -> f64 {
        const STEP: f64 = 1.0 / (1_u64 << 53) as f64;
        (self.bits() >> 11) as f64 * STEP
    }

    /// Uniform on [`low`, `high`).
    pub fn between(&mut self, low: f64, high: f64) -> f64 {
        low + (high - low) * self.uniform()
    }

    /// Normal with mean 0 and standard deviation 1 (Box and Muller).
    pub fn normal(&mut self) -> f64 {
        let radius = (-2.0 * (1.0 - self.uniform()).ln()).sqrt();
        radius * (TAU * self.uniform()).cos()
    }

    /// A whole number below `end`; 0 when `end` is 0.
    #[allow(
        clippy::cast_possible_truncation,
        clippy::cast_sign_loss,
        reason = "the product lies in [0, end)"
    )]
    pub fn below(&mut self, end: usize) -> usize {
        (self.uniform() * end as f64) as usize
    }

    /// Puts `items` in random order (Fisher and Yates).
    pub fn shuffle<T>(&mut self, items: &mut [T]) {
        for end in (2..=items.len()).rev() {
            items.swap(end - 1, self.below(end));
        }
    }
}

fn splitmix(state: &mut u64) -> u64 {
    *state = state.wrapping_add(0x9E37_79B9_7F4A_7C15);
    let mut z = *state;
    z = (z ^ (z >> 30)).wrapping_mul(0xBF58_476D_1CE4_E5B9);
    z = (z ^ (z >> 27)).wrapping_mul(0x94D0_49BB_1331_11EB);
    z ^ (z >> 31)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn splitmix_agrees_with_the_published_sequence() {
        // First outputs for seed 1234567, from the reference implementation's test vectors.
        let mut state = 1_234_567;
        assert_eq!(splitmix(&mut state), 6_457_827_717_110_365_317);
        assert_eq!(splitmix(&mut state), 3_203_168_211_198_807_973);
    }

    #[test]
    fn xoshiro_agrees_with_the_published_sequence() {
        // First outputs of xoshiro256++ from state (1, 2, 3, 4), from the rand_xoshiro crate's test.
        let mut random = Random {
            state: [1, 2, 3, 4],
        };
        let first: Vec<_> = (0..4).map(|_| random.bits()).collect();
        let published = [
            41_943_041,
            58_720_359,
            3_588_806_011_781_223,
            3_591_011_842_654_386,
        ];
        assert_eq!(first, published);
    }

    #[test]
    fn normal_numbers_have_mean_zero_and_unit_variance() {
        let mut random = Random::new(7);
        let values: Vec<_> = (0..40_000).map(|_| random.normal()).collect();
        let mean = values.iter().sum::<f64>() / values.len() as f64;
        let variance = values.iter().map(|v| v * v).sum::<f64>() / values.len() as f64;
        // Four standard errors: 4/sqrt(40000) = 0.02 and 4 sqrt(2/40000) = 0.028.
        assert!(mean.abs() < 0.02, "{mean}");
        assert!((variance - 1.0).abs() < 0.028, "{variance}");
    }

    #[test]
    fn parts_have_numbers_of_their_own() {
        assert_ne!(Random::for_part(1, 0).bits(), Random::for_part(1, 1).bits());
        assert_ne!(Random::for_part(1, 1).bits(), Random::for_part(2, 1).bits());
    }
}
