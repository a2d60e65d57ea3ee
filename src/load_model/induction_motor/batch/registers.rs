//! Which registers a group of motors is simulated in, and how its numbers lie there.

use pulp::{Arch, Simd, WithSimd};

use super::super::lanes::{InLanes, LaneScalar, Slopes, SpreadSlopes};
use super::{BatchSink, Effort, Members, Method, REGISTERS_EXACT, Rough};

impl<A: LaneScalar> Members<'_, A> {
    /// With one register of the fitting size per number: a rest that would leave half of one empty takes
    /// registers of half the size, which take half the time.
    pub(super) fn on_registers<M: Method, K: BatchSink>(
        self,
        arch: Arch,
        effort: Effort,
        sink: &mut K,
    ) {
        let (wide, narrow) = split(arch, self.indices);
        if !wide.is_empty() {
            let group = self.only(wide);
            arch.dispatch(group.with::<M, Abreast, K, REGISTERS_EXACT>(effort, sink));
        }
        if !narrow.is_empty() {
            let group = self.only(narrow);
            on_half_registers(
                arch,
                group.with::<M, Abreast, K, REGISTERS_EXACT>(effort, sink),
            );
        }
    }
}

impl Members<'_, Slopes> {
    /// Roughly, in registers of at most half the largest size: a number takes four of them, and in larger ones more
    /// motors would wait for the slowest. A motor that is left over has its derivatives in one register.
    pub(super) fn with_slopes<K: BatchSink>(self, arch: Arch, effort: Effort, sink: &mut K) {
        let single = has_spread(arch) && self.indices.len() % HALF_LANES == 1;
        let (some, last) = self
            .indices
            .split_at(self.indices.len() - usize::from(single));
        if !some.is_empty() {
            let group = self.only(some);
            on_half_registers(
                arch,
                group.with::<Rough, Abreast, K, REGISTERS_EXACT>(effort, sink),
            );
        }
        if !last.is_empty() {
            self.only(last).spread::<Rough, K>(arch, effort, sink);
        }
    }

    /// One motor after the other, the derivatives of each in one register.
    pub(super) fn spread<M: Method, K: BatchSink>(self, arch: Arch, effort: Effort, sink: &mut K) {
        for member in self.indices.chunks(1) {
            let group = self
                .only(member)
                .with::<M, Spread, K, REGISTERS_EXACT>(effort, sink);
            match arch {
                #[cfg(target_arch = "x86_64")]
                Arch::V4(all) => all.vectorize(HalfRegisters { simd: *all, group }),
                #[cfg(target_arch = "x86_64")]
                Arch::V3(simd) => simd.vectorize(HalfRegisters { simd, group }),
                // Nobody asks for it: see `has_spread`.
                _ => {}
            }
        }
    }
}

/// Lanes of the registers that numbers with derivatives take, where [`has_spread`].
const HALF_LANES: usize = 4;

/// Whether a register holds all derivatives of a number.
pub(super) fn has_spread(arch: Arch) -> bool {
    match arch {
        #[cfg(target_arch = "x86_64")]
        Arch::V4(_) | Arch::V3(_) => true,
        _ => false,
    }
}

/// Simulates a group in registers of at most half the largest size.
fn on_half_registers<G: WithSimd>(arch: Arch, group: G) -> G::Output {
    match arch {
        #[cfg(target_arch = "x86_64")]
        Arch::V4(all) => all.vectorize(HalfRegisters { simd: *all, group }),
        _ => arch.dispatch(group),
    }
}

/// A group in registers of 256 bits, compiled for an instruction set that may have more of them.
#[cfg(target_arch = "x86_64")]
struct HalfRegisters<G> {
    simd: pulp::x86::V3,
    group: G,
}

#[cfg(target_arch = "x86_64")]
impl<G: WithSimd> pulp::NullaryFnOnce for HalfRegisters<G> {
    type Output = G::Output;

    #[inline(always)]
    fn call(self) -> G::Output {
        self.group.with_simd(self.simd)
    }
}

/// How the numbers of motors lie in registers.
pub(super) trait Layout<A: LaneScalar> {
    /// Numbers of motors side by side.
    type Numbers<S: Simd, const W: usize>: InLanes<S, W, Alone = A>;
}

/// A motor per lane, each derivative in registers of its own.
pub(super) struct Abreast;
/// One motor, its derivatives in the lanes of one register.
pub(super) struct Spread;

impl<A: LaneScalar> Layout<A> for Abreast {
    type Numbers<S: Simd, const W: usize> = A::InLanes<S, W>;
}

impl Layout<Slopes> for Spread {
    type Numbers<S: Simd, const W: usize> = SpreadSlopes<S, W>;
}

/// The members that fill registers, and the rest.
fn split(arch: Arch, members: &[usize]) -> (&[usize], &[usize]) {
    let (whole, half) = match arch {
        #[cfg(target_arch = "x86_64")]
        Arch::V4(_) => (8, 4),
        _ => (1, 0),
    };
    let rest = members.len() % whole;
    members.split_at(if rest <= half {
        members.len() - rest
    } else {
        members.len()
    })
}
