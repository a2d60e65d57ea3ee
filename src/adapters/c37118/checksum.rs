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

/// The CRC of `bytes`.
pub(super) fn crc_ccitt(bytes: &[u8]) -> u16 {
    bytes.iter().fold(0xffff, |crc, &byte| {
        (crc << 8) ^ TABLE[usize::from((crc >> 8).to_be_bytes()[1] ^ byte)]
    })
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
}
