//! What the other stages of a bake may lose where one of them cannot reach what is asked for.

/// Share of what is reached that the others may be asked for: together they then add a tenth to its square.
const BESIDE: f64 = 0.4;

/// No stage is coarser than this for that reason: what is dim beside the rest would go black.
const COARSEST: f64 = 0.02;

/// The error to ask the other stages for, where one of them keeps its share of `reached` at best: finer than that costs bytes and hardly
/// lessens the whole.
pub(super) fn allowed(asked: f64, reached: f64) -> f64 {
    asked.max((BESIDE * reached).min(COARSEST))
}
