//! The check word CHK: CRC-CCITT, polynomial x^16 + x^12 + x^5 + 1, initial value all ones, no
//! final inversion (annex B of IEEE C37.118.2-2011).

/// CRC of every value of the leading byte.
const TABLE: [u16; 256] = {
    const POLYNOMIAL: u16 = 0x1021;
    let mut table = [0_u16; 256];
    let mut byte = 0_u16;
    while byte < 256 {
        let mut crc = byte << 8;
        let mut bit = 0;
        while bit < 8 {
            crc = if crc & 0x8000 == 0 {
                crc << 1
            } else {
                (crc << 1) ^ POLYNOMIAL
            };
            bit += 1;
        }
        table[byte as usize] = crc;
        byte += 1;
    }
    table
};

/// Value of the register before the first byte.
const INITIAL: u16 = 0xffff;

/// The register after one more byte.
fn step(crc: u16, byte: u8) -> u16 {
    (crc << 8) ^ TABLE[usize::from((crc >> 8).to_be_bytes()[1] ^ byte)]
}

/// The CRC of `bytes`.
pub(super) fn crc_ccitt(bytes: &[u8]) -> u16 {
    bytes.iter().fold(INITIAL, |crc, &byte| step(crc, byte))
}

/// x^(8 2^k) modulo the polynomial: what 2^k zero bytes do to the register, for k of 0 to 15.
const ZERO_BYTES: [u16; 16] = {
    let mut powers = [0_u16; 16];
    // x^8: the register holding 1 after eight shifts without overflow.
    powers[0] = 0x0100;
    let mut k = 1;
    while k < 16 {
        powers[k] = product(powers[k - 1], powers[k - 1]);
        k += 1;
    }
    powers
};

/// Product of two polynomials over GF(2) modulo the CRC's polynomial.
const fn product(a: u16, b: u16) -> u16 {
    let mut sum = 0;
    let mut bit = 16;
    while bit > 0 {
        bit -= 1;
        let carry = sum & 0x8000 != 0;
        sum <<= 1;
        if carry {
            sum ^= 0x1021;
        }
        if b >> bit & 1 == 1 {
            sum ^= a;
        }
    }
    sum
}

/// CRCs of any stretch of a growing run of bytes, each in at most sixteen products instead of one
/// step for each byte: the CRC is linear, so that of a stretch follows from those of the runs up to
/// its two ends.
#[derive(Clone, Debug)]
pub(super) struct StretchCrcs {
    /// Register, from zero at some origin, before each byte and after the last.
    registers: Vec<u16>,
}

impl StretchCrcs {
    /// Those of an empty run.
    pub(super) fn new() -> Self {
        Self { registers: vec![0] }
    }

    /// Makes the run as long as `bytes`, whose start it covers already.
    pub(super) fn cover(&mut self, bytes: &[u8]) {
        let covered = self.registers.len() - 1;
        let mut register = self.registers[covered];
        for &byte in &bytes[covered.min(bytes.len())..] {
            register = step(register, byte);
            self.registers.push(register);
        }
    }

    /// Takes the first `count` bytes, which must be covered, off the run.
    pub(super) fn drop_front(&mut self, count: usize) {
        self.registers.drain(..count.min(self.registers.len() - 1));
    }

    /// The CRC of the bytes from `start` to before `end`, less than 65 536 of them and covered.
    pub(super) fn of(&self, start: usize, end: usize) -> u16 {
        let before = self.registers[start] ^ INITIAL;
        let length = end - start;
        let powers = ZERO_BYTES.iter().enumerate();
        let shifted = powers
            .filter(|(k, _)| length >> k & 1 == 1)
            .fold(before, |register, (_, &power)| product(register, power));
        self.registers[end] ^ shifted
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn check_value_is_the_published_one() {
        // The catalogues list this CRC as CRC-16/IBM-3740 ("CCITT-FALSE") with check value 0x29B1.
        assert_eq!(crc_ccitt(b"123456789"), 0x29b1);
        assert_eq!(crc_ccitt(b""), 0xffff);
    }

    #[test]
    fn crc_of_a_stretch_is_that_of_its_bytes() {
        let bytes: Vec<u8> = (0_u32..40_000)
            .map(|n| n.wrapping_mul(2_654_435_761).to_be_bytes()[0])
            .collect();
        let mut crcs = StretchCrcs::new();
        crcs.cover(&bytes[..100]);
        crcs.cover(&bytes);
        for (start, end) in [(0, 0), (0, 1), (7, 8), (3, 300), (99, 101), (1, 40_000)] {
            assert_eq!(
                crcs.of(start, end),
                crc_ccitt(&bytes[start..end]),
                "{start}"
            );
        }
        crcs.drop_front(50);
        assert_eq!(crcs.of(10, 20_000), crc_ccitt(&bytes[60..20_050]));
    }
}
